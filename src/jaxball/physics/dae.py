"""The equations of motion as a differential-algebraic equation M ẋ = g(t, x), ``rolling_ball_dae``.

The paper replaces the equation for q̇₀ by |q|² − 1 = 0. That determines q₀ as long as q₀ ≠ 0, and the
problem has index 1 there and nowhere else; in the paper's own run of the ball q₀ passes 0 at t = 9.2067.
Any component can play the part of q₀, so it is chosen here: the largest is never below ½.
"""

from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..classical import RigidBodyState
from .dynamics import vector_field
from .simulable import AnySimulableState, SimulableState, SimulableSystem
from .state import BallState, ReducedState, RotationState

# The unit vector of each kind of state that has one.
UNIT = {BallState: "q", ReducedState: "Gamma", RigidBodyState: "q"}
WITH_UNIT = "a BallState, a ReducedState or a RigidBodyState"


def algebraic_component(state: SimulableState) -> Int[Array, ""]:
    """The component of q (of Γ, in a reduced state) that is largest in size."""
    return jnp.argmax(jnp.abs(_unit(state)))


def dae_field(
    system: SimulableSystem, t: Float[Array, ""], state: AnySimulableState, component: Int[Array, ""]
) -> AnySimulableState:
    """g(t, x) of ``rolling_ball_dae_g``, with ``component`` in the place of q₀.

    **Raises:** ``TypeError`` for states without a unit vector.
    """
    return constrained(vector_field(system, t, state), state, component)


def constrained(rates: AnySimulableState, state: AnySimulableState, component: Int[Array, ""]) -> AnySimulableState:
    """``rates`` with |q|² − 1 in the place of the rate of q's ``component``."""
    unit, rate = _unit(state), _unit(rates)
    residual = jnp.where(jnp.arange(unit.size) == component, jnp.sum(unit * unit) - 1, rate)
    return eqx.tree_at(_unit, rates, residual)


def mass_diagonal(state: AnySimulableState, component: Int[Array, ""]) -> AnySimulableState:
    """The diagonal of M for states of the kind of ``state``: 0 at q's ``component``, and 1."""
    ones = jax.tree.map(jnp.ones_like, state)
    return eqx.tree_at(_unit, ones, jnp.where(jnp.arange(_unit(state).size) == component, 0.0, _unit(ones)))


def projected(state: AnySimulableState) -> AnySimulableState:
    """The nearest state with |q| = 1, |Γ| = 1, or, up to squares of the distance, Λ orthogonal."""
    if isinstance(state, RotationState):
        R = state.Lambda
        gram = jnp.sum(R[:, :, None] * R[:, None, :], axis=0)
        nearer = 1.5 * R - 0.5 * jnp.sum(R[:, :, None] * gram[None], axis=1)
        return cast(AnySimulableState, eqx.tree_at(lambda s: s.Lambda, state, nearer))
    if type(state) not in UNIT:
        return state
    unit = _unit(state)
    return eqx.tree_at(_unit, state, unit / jnp.sqrt(jnp.sum(unit * unit)))


def has_unit(state: SimulableState) -> bool:
    """Whether states of this kind hold a unit vector, and so can be a differential-algebraic equation's."""
    return type(state) in UNIT


def _unit(state: SimulableState) -> Any:
    """The unit vector of a state, or what stands in its place while a state is taken apart."""
    if type(state) not in UNIT:
        raise TypeError(
            f"Argument `state` must be {WITH_UNIT} for the differential-algebraic form, which determines a "
            f"component of a unit vector from the others, but it is a {type(state).__name__}."
        )
    return getattr(state, UNIT[type(state)])
