"""The equations of motion of the rolling ball and disk: their angular acceleration.

With it, a state knows its rates (``state``). A solve advances the equations of ``locked``, which are equivalent. Labels
are those of the equations in Putkaradze & Rogers (2018).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.arguments import require_value
from ..numerics.trigonometry import sine_cosine
from ..numerics.vectors import apply, cross, dot, outer, solve
from .moments import AbstractMoments, Moments, moments
from .parameters import BodyParameters
from .state import BallState, DiskState, Rates, ReducedState, RotationState, State


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


def driven_angles(system: BodyParameters, t: Float[Array, ""], state: State) -> Rates:
    """θ, θ̇ and θ̈ = u(t, state) of the driven masses."""
    if system.law is None:
        return state.theta, state.thetadot, state.theta
    thetaddot = system.law(t, state)
    require_value("law", thetaddot, (len(system.driven),))
    return state.theta, state.thetadot, thetaddot


def ball_acceleration(
    ball: BodyParameters, t: Float[Array, ""], state: BallState | RotationState | ReducedState, angles: Rates
) -> Float[Array, "3"]:
    """Ω̇ of a ball at time ``t``."""
    Ftilde = force_in_body(ball, t, state)
    at = moments(ball, t, angles)
    return angular_acceleration(at, ball.radius, ball.gravity, state.Omega, state.Gamma, Ftilde)


def disk_acceleration(disk: BodyParameters, t: Float[Array, ""], state: DiskState, angles: Rates) -> Float[Array, "3"]:
    """Ω̇ = −φ̈ E2 of a disk at time ``t``."""
    force = None if disk.force is None else disk.force(t)[0]
    phiddot = rolling_acceleration(moments(disk, t, angles), disk.radius, disk.gravity, state.phi, state.phidot, force)
    zero = jnp.zeros_like(phiddot)
    return jnp.stack([zero, -phiddot, zero])


def force_in_body(system: BodyParameters, t: Float[Array, ""], state: State) -> Float[Array, "3"] | None:
    """F̃ = Λ⁻¹Fe, or None where no force acts. Reduced states, which do not know Λ, are refused where one does."""
    if system.force is None:
        return None
    assert not isinstance(state, ReducedState)
    return apply(state.Lambda.T, system.force(t))


def rolling_acceleration(
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
