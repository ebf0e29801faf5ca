"""Quantities of a ball or a disk that reductions look at."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.norms import root
from ..numerics.vectors import cross
from ..physics.body import System
from ..physics.contact import reaction
from ..physics.observables import observe
from ..physics.state import BallState, DiskState, State
from .reductions import AbstractReduction, Drift, Integral, Maximum, Minimum


def normal_force(system: System, t: Float[Array, ""], state: State) -> Float[Array, ""]:
    """N, the normal force."""
    return reaction(system, t, state).normal


def friction(system: System, t: Float[Array, ""], state: State) -> Float[Array, ""]:
    """|f|, the friction."""
    return reaction(system, t, state).friction


def half_tangent(system: System, t: Float[Array, ""], state: State) -> Float[Array, ""]:
    """tan(α/2) for the angle α of the reaction from the vertical, which grows with |f| / N, smoothly past N = 0.

    Without an arctangent, which takes as long as half of the equations of motion.
    """
    R = reaction(system, t, state)
    return R.friction / (R.normal + jnp.sqrt(R.normal**2 + R.friction_squared))


def tangent(half: Float[Array, "*runs"]) -> Float[Array, "*runs"]:
    """|f| / N = tan α from tan(α/2); infinite where N ≤ 0."""
    held = ~(half >= 1)
    return jnp.where(held, 2 * half / jnp.where(held, 1 - half**2, 1.0), jnp.inf)


def angular_speed_squared(system: System, t: Float[Array, ""], state: State) -> Float[Array, ""]:
    """|Ω|²."""
    return jnp.sum(state.Omega**2)


def speed(system: System, t: Float[Array, ""], state: State) -> Float[Array, ""]:
    """|ż|, how fast the geometric centre moves: r times the horizontal part of the angular velocity."""
    return system.radius * root(jnp.sum(cross(state.Omega, state.Gamma) ** 2))


def energy(system: System, t: Float[Array, ""], state: BallState | DiskState) -> Float[Array, ""]:
    """E, kinetic and potential."""
    return observe(system, t, state).energy


CONTACT: dict[str, AbstractReduction] = {
    "least_normal_force": Minimum(normal_force),
    "friction_needed": Maximum(half_tangent, tangent),
    "largest_friction": Maximum(friction),
}
REDUCTIONS: dict[str, AbstractReduction] = {
    **CONTACT,
    "largest_angular_speed": Maximum(angular_speed_squared, jnp.sqrt),
    "distance": Integral(speed),
    "energy_drift": Drift(energy),
}
