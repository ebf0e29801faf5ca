"""The equations of motion as a differential-algebraic equation M ẋ = g(t, x), ``rolling_ball_dae``, for ``dae=True``.

The paper replaces the equation for q̇₀ by |q|² − 1 = 0. That determines q₀ as long as q₀ ≠ 0, and the problem has index
1 there and nowhere else; in the paper's own run of the ball q₀ passes 0 at t = 9.2067. Any component can take the role
of q₀, so the largest one is chosen, which is never below ½. The same holds for any other unit vector of a state, such
as Γ.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .system import AbstractState, AbstractSystem, AnyState, vector_field

WITH_UNIT = "a state with a unit vector, such as a BallState, a ReducedState or a RigidBodyState"


def algebraic_component(state: AbstractState) -> Int[Array, ""]:
    """Finds the component of q (of Γ, in a reduced state) that is largest in size."""
    return jnp.argmax(jnp.abs(_unit_of(state)(state)))


def dae_field(system: AbstractSystem, t: Float[Array, ""], state: AnyState, component: Int[Array, ""]) -> AnyState:
    """Computes g(t, x) of ``rolling_ball_dae_g``, with ``component`` in place of q₀.

    **Raises:** ``TypeError`` for states without a unit vector.
    """
    return constrain(vector_field(system, t, state), state, component)


def constrain(rates: AnyState, state: AnyState, component: Int[Array, ""]) -> AnyState:
    """Puts |q|² − 1 in place of the rate of q's ``component`` in ``rates``."""
    unit = _unit_of(state)
    q = unit(state)
    residual = jnp.where(jnp.arange(q.size) == component, jnp.sum(q * q) - 1, unit(rates))
    return eqx.tree_at(unit, rates, residual)


def mass_diagonal(state: AnyState, component: Int[Array, ""]) -> AnyState:
    """Returns the diagonal of M for states of the kind of ``state``: 0 at q's ``component``, and 1."""
    unit, ones = _unit_of(state), jax.tree.map(jnp.ones_like, state)
    return eqx.tree_at(unit, ones, jnp.where(jnp.arange(unit(state).size) == component, 0.0, unit(ones)))


def _unit_of(state: AbstractState) -> Any:
    """Returns the function that takes a state of this kind to its unit vector."""
    name = state.unit_vector
    if name is None:
        raise TypeError(
            f"Argument `state` must be {WITH_UNIT} for the differential-algebraic form, which determines a "
            f"component of a unit vector from the others, but it is a {type(state).__name__}."
        )
    return lambda state: getattr(state, name)
