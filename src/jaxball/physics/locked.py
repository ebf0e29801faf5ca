"""The equations of motion for the locked angular velocity, which a solve advances in the place of Ω.

W = B⁻¹Π is the angular velocity that the ball would have if its masses were stopped in it at once, for
that leaves the momentum Π about the contact point as it is. Ẇ holds no acceleration of a mass, where Ω̇
does. So where θ̈ jumps, Ω̇ jumps and Ẇ does not, and the derivative of a solve with respect to the time
of the jump is right for each mass, also when several masses jump at once.
"""

from typing import TypeVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.vectors import apply, cross, dot, inverse, outer, solve
from .dynamics import driven_angles, force_in_body, inertia_about_contact
from .moments import AbstractMoments, velocity_moments
from .momentum import contact_momentum_rate, internal_momentum
from .parameters import BodyParameters
from .state import BallState, DiskState, ReducedState, RotationState, State

AnyState = TypeVar("AnyState", BallState, RotationState, ReducedState, DiskState)


def to_locked(system: BodyParameters, t: Float[Array, ""], state: AnyState) -> AnyState:
    """``state`` with W in the place of Ω; for a disk, with its component in the place of φ̇."""
    return state.with_Omega(state.Omega + _excess(system, t, state))


def from_locked(system: BodyParameters, t: Float[Array, ""], state: AnyState) -> AnyState:
    """The inverse of :func:`to_locked`."""
    return state.with_Omega(state.Omega - _excess(system, t, state))


def locked_field(system: BodyParameters, t: Float[Array, ""], state: AnyState) -> AnyState:
    """The rates of a state that holds W in the place of Ω: Ẇ = B⁻¹ (Π̇ − ḂW) with Π = BW."""
    r, g, W, Gamma = system.radius, system.gravity, state.Omega, state.Gamma
    at = velocity_moments(system, t, (state.theta, state.thetadot))
    B = inertia_about_contact(at, r, Gamma)
    inverse_B = inverse(B)
    Omega = W - apply(inverse_B, internal_momentum(at, r, Gamma))
    state = state.with_Omega(Omega)
    Pidot = contact_momentum_rate(at, r, g, apply(B, W), Omega, Gamma, force_in_body(system, t, state))
    Bdot = inertia_about_contact_rate(at, r, Gamma, cross(Gamma, Omega))
    Wdot = apply(inverse_B, Pidot - apply(Bdot, W))
    return state.rates(r, Wdot, driven_angles(system, t, state))


def inertia_about_contact_rate(
    at: AbstractMoments, r: Float[Array, ""], Gamma: Float[Array, "3"], Gammadot: Float[Array, "3"]
) -> Float[Array, "3 3"]:
    """Ḃ, by the rule of products."""
    turn = outer(Gammadot, Gamma)
    mixed = outer(Gammadot, at.p) + outer(Gamma, at.pdot)
    trace = dot(Gammadot, at.p) + dot(Gamma, at.pdot)
    identity = jnp.eye(3, dtype=Gamma.dtype)
    return at.Jdot - at.M * r**2 * (turn + turn.T) + r * (2 * trace * identity - mixed - mixed.T)


def _excess(system: BodyParameters, t: Float[Array, ""], state: State) -> Float[Array, "3"]:
    """W − Ω."""
    at = velocity_moments(system, t, (state.theta, state.thetadot))
    B = inertia_about_contact(at, system.radius, state.Gamma)
    return solve(B, internal_momentum(at, system.radius, state.Gamma))
