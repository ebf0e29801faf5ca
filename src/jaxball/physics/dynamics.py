"""The equations of motion of the rolling ball and disk, and nothing else.

Each function is pure: parameters, time and state in, rates out. Labels are those of the equations in
Putkaradze & Rogers (2018).
"""

from collections.abc import Callable
from typing import Any, TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..classical import AbstractClassicalSystem
from ..interface.arguments import described, require_value
from ..numerics import versor
from ..numerics.trigonometry import sine_cosine
from ..numerics.vectors import apply, cross, dot, hat, outer, solve
from .body import Ball, Disk, System
from .moments import AbstractMoments, Moments, Rates, moments
from .simulable import AnySimulableState, SimulableState, SimulableSystem, require_system
from .state import BallState, DiskState, ReducedState, RotationState, State


def angular_acceleration(
    at: Moments,
    r: Float[Array, ""],
    g: Float[Array, ""],
    Omega: Float[Array, "3"],
    Gamma: Float[Array, "3"],
    Ftilde: Float[Array, "3"] | None = None,
) -> Float[Array, "3"]:
    """Ω̇ from the moments of the masses: ``uncon_ball_eqns_explicit``, its sums over masses carried out.

    ``Ftilde`` is the external force in body axes, F̃ = Λ⁻¹Fe.
    """
    rGamma = r * Gamma
    torque = (
        cross(Omega, apply(at.J, Omega) + at.l)
        + apply(at.Jdot, Omega)
        + at.ldot
        + cross(rGamma, cross(Omega, cross(Omega, at.p) + 2 * at.pdot) + at.pddot)
        + g * cross(at.p, Gamma)
    )
    if Ftilde is not None:
        torque = torque + r * cross(Ftilde, Gamma)
    return -solve(inertia_about_contact(at, r, Gamma), torque)


def inertia_about_contact(at: AbstractMoments, r: Float[Array, ""], Gamma: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """B = 𝕀 − Σ m ŝ², the inertia about the contact point, with s = rΓ + χ. Symmetric positive definite."""
    identity = jnp.eye(3, dtype=Gamma.dtype)
    mixed = outer(Gamma, at.p)
    return (
        at.J + at.M * r**2 * (identity - outer(Gamma, Gamma)) + r * (2 * dot(Gamma, at.p) * identity - mixed - mixed.T)
    )


def driven_angles(system: System, t: Float[Array, ""], state: State) -> Rates:
    """θ, θ̇ and θ̈ = u(t, state) of the driven masses."""
    if system.law is None:
        return state.theta, state.thetadot, state.theta
    found = system.law(t, state)
    require_value("law", found, (len(system.driven),))
    return state.theta, state.thetadot, found


def ball_field(ball: Ball, t: Float[Array, ""], state: BallState) -> BallState:
    """ẋ of the full system with a versor, ``rolling_ball_ode_f``."""
    angles = driven_angles(ball, t, state)
    return ball_rates(ball, state, ball_acceleration(ball, t, state, angles), angles)


def ball_rates(ball: Ball, state: BallState, Omegadot: Float[Array, "3"], angles: Rates) -> BallState:
    """ẋ where Ω̇ is known: q̇ = ½ q Ω♯ and the rolling constraint."""
    return BallState(
        q=versor.derivative(state.q, state.Omega),
        Omega=Omegadot,
        z=rolling_velocity(state.Lambda, state.Omega, ball.radius),
        theta=angles[1],
        thetadot=angles[2],
    )


def rotation_field(ball: Ball, t: Float[Array, ""], state: RotationState) -> RotationState:
    """ẋ of the full system with a rotation matrix, ``uncon_ball_eqns_explicit_full``."""
    angles = driven_angles(ball, t, state)
    return rotation_rates(ball, state, ball_acceleration(ball, t, state, angles), angles)


def rotation_rates(ball: Ball, state: RotationState, Omegadot: Float[Array, "3"], angles: Rates) -> RotationState:
    """ẋ where Ω̇ is known: Λ̇ = Λ Ω̂ and the rolling constraint."""
    return RotationState(
        Lambda=jnp.sum(state.Lambda[:, :, None] * hat(state.Omega)[None, :, :], axis=1),
        Omega=Omegadot,
        z=rolling_velocity(state.Lambda, state.Omega, ball.radius),
        theta=angles[1],
        thetadot=angles[2],
    )


def reduced_field(ball: Ball, t: Float[Array, ""], state: ReducedState) -> ReducedState:
    """(Ω̇, Γ̇) of the system reduced by the symmetry of the plane, ``uncon_ball_eqns_explicit``.

    **Raises:** ``ValueError`` when a force acts: its body components are not functions of (Ω, Γ).
    """
    angles = driven_angles(ball, t, state)
    return reduced_rates(ball, state, ball_acceleration(ball, t, state, angles), angles)


def reduced_rates(ball: Ball, state: ReducedState, Omegadot: Float[Array, "3"], angles: Rates) -> ReducedState:
    """(Ω̇, Γ̇) where Ω̇ is known: Γ̇ = Γ × Ω."""
    return ReducedState(Omega=Omegadot, Gamma=cross(state.Gamma, state.Omega), theta=angles[1], thetadot=angles[2])


def ball_acceleration(
    ball: Ball, t: Float[Array, ""], state: BallState | RotationState | ReducedState, angles: Rates
) -> Float[Array, "3"]:
    """Ω̇ of a ball at time ``t``."""
    Ftilde = force_in_body(ball, t, state)
    at = moments(ball, t, angles)
    return angular_acceleration(at, ball.radius, ball.gravity, state.Omega, state.Gamma, Ftilde)


def force_in_body(system: System, t: Float[Array, ""], state: State) -> Float[Array, "3"] | None:
    """F̃ = Λ⁻¹Fe, or None where no force acts.

    **Raises:** ``ValueError`` for a reduced state, which does not know the force's direction in the body.
    """
    if system.force is None:
        return None
    if isinstance(state, ReducedState):
        raise ValueError(
            "Argument `ball` must have no external force in the reduced system, because the force's "
            "direction in the body is not known from (Omega, Gamma); use a BallState."
        )
    return apply(state.Lambda.T, system.force(t))


def rolling_velocity(Lambda: Float[Array, "3 3"], Omega: Float[Array, "3"], r: Float[Array, ""]) -> Float[Array, "2"]:
    """ż = (ΛΩ × r e3)₁₂, the rolling constraint at the geometric centre."""
    omega1 = dot(Lambda[0], Omega)
    omega2 = dot(Lambda[1], Omega)
    return jnp.stack([r * omega2, -r * omega1])


def disk_acceleration(
    at: Moments,
    r: Float[Array, ""],
    g: Float[Array, ""],
    phi: Float[Array, ""],
    phidot: Float[Array, ""],
    force: Float[Array, ""] | None = None,
) -> Float[Array, ""]:
    """φ̈ = κ, ``eqmo_chap_disk_4``, its sums over masses carried out; ``force`` is Fe along e1."""
    s, c = sine_cosine(phi)
    p, pdot, pddot = at.p, at.pdot, at.pddot
    # Σ m K_i of eq_K_i, term by term; Σ m (ζ3 ζ̈1 − ζ1 ζ̈3) is the second component of ldot.
    K = (
        (g + r * phidot**2) * (p[2] * s - p[0] * c)
        + r * c * (-2 * phidot * pdot[2] + pddot[0])
        - r * s * (2 * phidot * pdot[0] + pddot[2])
        + at.ldot[1]
        - phidot * at.Jdot[1, 1]
    )
    inertia = at.J[1, 1] + at.M * r**2 + 2 * r * (p[0] * s + p[2] * c)
    return (K if force is None else K - r * force) / inertia


def disk_field(disk: Disk, t: Float[Array, ""], state: DiskState) -> DiskState:
    """ẋ of the disk, ``eq_rdisk_dynamics``."""
    angles = driven_angles(disk, t, state)
    at = moments(disk, t, angles)
    force = None if disk.force is None else disk.force(t)[0]
    phiddot = disk_acceleration(at, disk.radius, disk.gravity, state.phi, state.phidot, force)
    return disk_rates(disk, state, phiddot, angles)


def disk_rates(disk: Disk, state: DiskState, phiddot: Float[Array, ""], angles: Rates) -> DiskState:
    """ẋ where φ̈ is known, with ż = −r φ̇ of ``eq_disk_GC``."""
    return DiskState(
        phi=state.phidot, phidot=phiddot, z=-disk.radius * state.phidot, theta=angles[1], thetadot=angles[2]
    )


FIELDS: dict[tuple[type, type], Callable[..., Any]] = {
    (Ball, BallState): ball_field,
    (Ball, RotationState): rotation_field,
    (Ball, ReducedState): reduced_field,
    (Disk, DiskState): disk_field,
}
AnyState = TypeVar("AnyState", bound=State)


def vector_field(system: SimulableSystem, t: Float[Array, ""], state: AnySimulableState) -> AnySimulableState:
    """ẋ = f(t, x) for the system and the kind of state given.

    **Arguments:**

    - ``system``: a body, or a system of :mod:`jaxball.classical`.
    - ``t``: time.
    - ``state``: of any kind that the system has.

    **Raises:** ``TypeError`` when the system has no state of that kind.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState, vector_field
    >>> rates = vector_field(Disk(mass=1.0, inertia=0.5, radius=2.0), jnp.array(0.0), DiskState(phidot=-1.0))
    >>> float(rates.z)  # ż = −r φ̇
    2.0
    """
    return field_of(system, state)(system, t, state)


def field_of(system: SimulableSystem, state: SimulableState) -> Callable[..., Any]:
    """The equations of motion for the system and the kind of state given.

    **Raises:** ``TypeError`` when the system has no state of that kind.
    """
    require_system(system)
    if isinstance(system, AbstractClassicalSystem):
        return _classical_field_of(system, state)
    field = FIELDS.get((type(system), type(state)))
    if field is None:
        raise TypeError(
            f"Argument `state` must be a state of a {type(system).__name__}, but it is {described(state)}; "
            "a Ball takes a BallState, RotationState or ReducedState, and a Disk takes a DiskState."
        )
    return field


def _classical_field_of(system: AbstractClassicalSystem, state: SimulableState) -> Callable[..., Any]:
    if not isinstance(state, system.state_type):
        raise TypeError(
            f"Argument `state` must be a {system.state_type.__name__} for a {type(system).__name__}, but it is "
            f"{described(state)}."
        )
    return type(system).field
