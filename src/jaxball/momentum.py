"""The equations of motion for the momentum about the contact point, and the balance of momentum.

Π̇ contains no acceleration of a mass, where Ω̇ does. So where θ̈ jumps, Ω̇ jumps and Π̇ does not, and the
derivative of a solve with respect to the time of the jump is right for each mass, also when several
masses jump at once. A solve therefore advances Π in the place of Ω. All vectors are in body axes; the
velocity of a mass in space is Ω × s + χ̇ with s = rΓ + χ.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .body import System
from .dynamics import (
    AnyState,
    ball_rates,
    disk_rates,
    driven_angles,
    force_in_body,
    inertia_about_contact,
    reduced_rates,
    rotation_rates,
)
from .moments import AbstractMoments, velocity_moments
from .state import BallState, DiskState, ReducedState, RotationState
from .vectors import apply, cross, solve

RATES: dict[type, Callable[..., Any]] = {
    BallState: ball_rates,
    RotationState: rotation_rates,
    ReducedState: reduced_rates,
    DiskState: disk_rates,
}


def linear_momentum(
    at: AbstractMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, "3"]:
    """P = Σ m (Ω × s + χ̇)."""
    return cross(Omega, at.M * r * Gamma + at.p) + at.pdot


def contact_momentum(
    at: AbstractMoments, r: Float[Array, ""], Omega: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Π = 𝕀Ω + Σ m s × (Ω × s + χ̇) = BΩ + rΓ × ṗ + ℓ, the angular momentum about the contact point."""
    return apply(inertia_about_contact(at, r, Gamma), Omega) + r * cross(Gamma, at.pdot) + at.l


def angular_velocity(
    at: AbstractMoments, r: Float[Array, ""], Pi: Float[Array, "3"], Gamma: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Ω = B⁻¹ (Π − rΓ × ṗ − ℓ), the inverse of :func:`contact_momentum`."""
    return solve(inertia_about_contact(at, r, Gamma), Pi - r * cross(Gamma, at.pdot) - at.l)


def contact_momentum_rate(
    at: AbstractMoments,
    r: Float[Array, ""],
    g: Float[Array, ""],
    Pi: Float[Array, "3"],
    Omega: Float[Array, "3"],
    Gamma: Float[Array, "3"],
    Ftilde: Float[Array, "3"] | None = None,
) -> Float[Array, "3"]:
    """Π̇ = Π × Ω + g Γ × p + rΓ × F̃ + (rΓ × Ω) × P.

    The last term is there because the contact point moves along the plane. Where p = 0 at all times
    and no force acts, ΛΠ is constant (Chaplygin's sphere), also while the masses move.
    """
    push = g * at.p if Ftilde is None else g * at.p + r * Ftilde
    P = linear_momentum(at, r, Omega, Gamma)
    return cross(Pi, Omega) + cross(Gamma, push) + cross(r * cross(Gamma, Omega), P)


def to_momentum(system: System, t: Float[Array, ""], state: AnyState, unit: Float[Array, ""]) -> AnyState:
    """``state`` with Π / ``unit`` in the place of Ω; for a disk, its component in the place of φ̇."""
    at = velocity_moments(system, t, (state.theta, state.thetadot))
    return _with_omega(state, contact_momentum(at, system.radius, state.Omega, state.Gamma) / unit)


def to_velocity(system: System, t: Float[Array, ""], state: AnyState, unit: Float[Array, ""]) -> AnyState:
    """The inverse of :func:`to_momentum`."""
    at = velocity_moments(system, t, (state.theta, state.thetadot))
    return _with_omega(state, angular_velocity(at, system.radius, unit * state.Omega, state.Gamma))


def momentum_field(system: System, t: Float[Array, ""], state: AnyState, unit: Float[Array, ""]) -> AnyState:
    """The rates of a state that holds Π / ``unit`` in the place of Ω."""
    at = velocity_moments(system, t, (state.theta, state.thetadot))
    Pi, Gamma = unit * state.Omega, state.Gamma
    Omega = angular_velocity(at, system.radius, Pi, Gamma)
    state = _with_omega(state, Omega)
    Ftilde = force_in_body(system, t, state)
    rate = contact_momentum_rate(at, system.radius, system.gravity, Pi, Omega, Gamma, Ftilde) / unit
    angles = driven_angles(system, t, state)
    return RATES[type(state)](system, state, -rate[1] if isinstance(state, DiskState) else rate, angles)


def inertia_scale(system: System) -> Float[Array, ""]:
    """The mean of the shell's principal moments, plus M r²: the unit in which Π is of the size of Ω."""
    return jnp.mean(system.inertia) + system.total_mass * system.radius**2


def _with_omega(state: AnyState, Omega: Float[Array, "3"]) -> AnyState:
    if isinstance(state, DiskState):
        return eqx.tree_at(lambda s: s.phidot, state, -Omega[1])
    return eqx.tree_at(lambda s: s.Omega, state, Omega)
