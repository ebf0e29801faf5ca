"""The order and length of the next step of an Adams method: the rules of the code STEP.

Shampine & Gordon, *Computer Solution of Ordinary Differential Equations* (1975), chapter 7.
"""

from typing import NamedTuple

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


def plan(errors: Float[Array, " rows"], order: Int[Array, ""], equal: Int[Array, ""], rising: Bool[Array, ""]) -> Plan:
    """The plan after a step.

    **Arguments:**

    - ``errors``: of the formula of each order j = 0, 1, …, in units of the tolerance, if all steps had the length of
      this one; those beyond the available points mean nothing.
    - ``order``: that of the step, k.
    - ``equal``: how many steps, this one included, had the same length. The error of order k + 1 is trusted after
      k + 1 of them.
    - ``rising``: as it was.
    """
    k, highest = order, errors.size - 1

    def of(j: Int[Array, ""]) -> Float[Array, ""]:
        return jnp.sum(jnp.where(jnp.arange(errors.size) == j, errors, 0.0))

    here, lower, lowest, higher = of(k), of(k - 1), of(k - 2), of(k + 1)
    falls = jnp.where(k > 2, jnp.maximum(lower, lowest) <= here, (k == 2) & (lower <= 0.5 * here))
    rising = rising & ~falls & (k < highest)
    judged = ~rising & ~falls & (equal > k) & (k < highest)
    falls |= judged & (k > 1) & (lower <= jnp.minimum(here, higher))
    rises = judged & ~falls & (higher < jnp.where(k == 1, 0.5 * here, here))
    new = jnp.where(falls, k - 1, jnp.where(rises | rising, k + 1, k))
    error = jnp.where(falls, lower, jnp.where(rises, higher, here))
    doubled = rising | (error * 2.0 ** (new + 1).astype(error.dtype) <= TARGET)
    kept = jnp.where(error <= TARGET, 1.0, jnp.clip(_ratio(error, new), 0.5, 0.9))
    shrink = jnp.clip(_ratio(here, k), SHORTEST, 0.5)
    return Plan(new, rising, jnp.where(doubled, 2.0, kept), jnp.where(jnp.isfinite(here), shrink, 0.1))


def _ratio(error: Float[Array, ""], order: Int[Array, ""]) -> Float[Array, ""]:
    """The ratio of the length of a step that meets the target to that of one with ``error``."""
    safe = jnp.where((error > 0) & jnp.isfinite(error), error, 1.0)
    return (TARGET / safe) ** (1.0 / (order + 1).astype(error.dtype))
