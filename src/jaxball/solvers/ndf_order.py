"""The order and length of the next step of a numerical differentiation formula."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

# The next step over the one that would have an error of 1, by the estimate.
CAUTION = 0.8
# Below this increase the step stays as it is, and so do the matrices of Newton's iteration.
LEAST_GROWTH = 1.2
GREATEST_GROWTH = 10.0
# If the error is so close to 1 that the next step should be shorter than this, it is shortened, before it fails.
LONGEST_SHRUNK = 0.9
SHORTEST, LONGEST_AGAIN = 0.2, 0.8
# After an iteration that did not converge.
GIVEN_UP = 0.3


class Plan(NamedTuple):
    """The plan after a step.

    - ``order``: that of the next step.
    - ``growth``: the next step over this one, if this one is accepted.
    - ``shrink``: the same if it is rejected.
    """

    order: Int[Array, ""]
    growth: Float[Array, ""]
    shrink: Float[Array, ""]


def plan(errors: Float[Array, "3"], order: Int[Array, ""], equal: Int[Array, ""], highest: int) -> Plan:
    """The plan after a step.

    **Arguments:**

    - ``errors``: of a step of this length by the formulas of order k − 1, k and k + 1, in units of the tolerance.
    - ``order``: that of the step, k, and ``highest`` the highest available.
    - ``equal``: how many steps, this one included, had the same length and order. Estimates are trusted after k + 1.
    """
    ready = equal > order
    orders = order - 1 + jnp.arange(3)
    exists = (orders >= 1) & (orders <= highest)
    # Whether the next step by each order would be longer than this one by this factor, computed without powers.
    grows = exists & (errors <= _error_of(LEAST_GROWTH, orders, highest, errors.dtype))
    stays = exists & (errors <= _error_of(LONGEST_SHRUNK, orders, highest, errors.dtype))
    changes = ready & (jnp.any(grows) | ~jnp.any(stays))

    def changed() -> Plan:
        lengths = jnp.where(exists, CAUTION * _ratio(errors, orders), 0.0)
        longest, here = jnp.max(lengths), lengths[1]
        kept = jnp.where(ready | stays[1], 1.0, here)
        growth = jnp.where(changes, jnp.minimum(longest, GREATEST_GROWTH), kept)
        again = jnp.clip(LONGEST_SHRUNK * here, SHORTEST, LONGEST_AGAIN)
        shrink = jnp.where(jnp.isfinite(errors[1]), again, GIVEN_UP)
        return Plan(jnp.where(changes, order - 1 + jnp.argmax(lengths), order), growth, shrink)

    # Most steps change nothing, and powers are a large part of the cost of a step with few equations.
    same = Plan(order, jnp.ones_like(errors[1]), jnp.ones_like(errors[1]))
    return jax.lax.cond(changes | ~stays[1], changed, lambda: same)


def _error_of(growth: float, orders: Int[Array, "3"], highest: int, dtype: Any) -> Float[Array, "3"]:
    """The error of a step of each order, where the next one is to be ``growth`` times as long."""
    errors = jnp.asarray((CAUTION / growth) ** np.arange(1, highest + 3), dtype)
    return jnp.sum(jnp.where(orders[:, None] == jnp.arange(highest + 2)[None], errors[None], 0.0), axis=1)


def _ratio(errors: Float[Array, "3"], orders: Int[Array, "3"]) -> Float[Array, "3"]:
    """The ratio of the length of a step with the error 1 to that of one with ``errors``."""
    safe = jnp.where((errors > 0) & jnp.isfinite(errors), errors, jnp.finfo(errors.dtype).tiny)
    return (1 / safe) ** (1.0 / (orders + 1).astype(errors.dtype))
