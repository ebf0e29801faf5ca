"""The order and length of the next step of an Adams method: the rules of the code STEP.

Shampine & Gordon, *Computer Solution of Ordinary Differential Equations* (1975), chapter 7.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

# The target error of a step, relative to the tolerance. With STEP's own 0.5 a run takes 7 % fewer evaluations and has
# an error three to four times as large: the same work for a given error, but less control by the tolerance, and more
# rejected steps.
TARGET = 0.1
SHORTEST = 1e-4


class Plan(NamedTuple):
    """The plan after a step.

    - ``order``: that of the next step.
    - ``rising``: whether the run is still starting, its order and its step growing from step to step.
    - ``growth``: the next step over this one, if this one is accepted.
    - ``shrink``: the same if it is rejected.
    """

    order: Int[Array, ""]
    rising: Bool[Array, ""]
    growth: Float[Array, ""]
    shrink: Float[Array, ""]


class Errors(NamedTuple):
    """The errors of a step, in units of the tolerance.

    - ``step``: its own.
    - ``orders``: those of the formulas of order k − 2 to k + 1, with k that of the step, if all steps had the length of
      this one; those beyond the available points mean nothing.
    """

    step: Float[Array, ""]
    orders: Float[Array, "4"]


def plan(errors: Errors, order: Int[Array, ""], equal: Int[Array, ""], rising: Bool[Array, ""], highest: int) -> Plan:
    """The plan after a step.

    **Arguments:**

    - ``order``: that of the step, k, and ``highest`` the highest available.
    - ``equal``: how many steps, this one included, had the same length. The error of order k + 1 is trusted after
      k + 1 of them.
    - ``rising``: as it was.
    """
    k = order
    lowest, lower, here, higher = errors.orders
    falls = jnp.where(k > 2, jnp.maximum(lower, lowest) <= here, (k == 2) & (lower <= 0.5 * here))
    rising = rising & ~falls & (k < highest)
    judged = ~rising & ~falls & (equal > k) & (k < highest)
    falls |= judged & (k > 1) & (lower <= jnp.minimum(here, higher))
    rises = judged & ~falls & (higher < jnp.where(k == 1, 0.5 * here, here))
    new = jnp.where(falls, k - 1, jnp.where(rises | rising, k + 1, k))
    error = jnp.where(falls, lower, jnp.where(rises, higher, here))
    doubled = rising | (error * (1 << (new + 1)).astype(error.dtype) <= TARGET)

    def shortened() -> tuple[Float[Array, ""], Float[Array, ""]]:
        kept = jnp.where(error <= TARGET, 1.0, jnp.clip(_ratio(error, new), 0.5, 0.9))
        shrink = jnp.clip(_ratio(here, k), SHORTEST, 0.5)
        return kept, jnp.where(jnp.isfinite(here), shrink, 0.1)

    # Most steps are accepted and followed by one as long or twice as long, and powers cost as much as the rest.
    unchanged = (errors.step <= 1) & (doubled | (error <= TARGET))
    same = jnp.ones_like(error), jnp.full_like(error, 0.5)
    kept, shrink = jax.lax.cond(unchanged, lambda: same, shortened)
    return Plan(new, rising, jnp.where(doubled, 2.0, kept), shrink)


def _ratio(error: Float[Array, ""], order: Int[Array, ""]) -> Float[Array, ""]:
    """The ratio of the length of a step that meets the target to that of one with ``error``."""
    safe = jnp.where((error > 0) & jnp.isfinite(error), error, 1.0)
    return (TARGET / safe) ** (1.0 / (order + 1).astype(error.dtype))
