"""When to stop an iteration that solves the stages of a step, and when to give it up."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

# The rate of the last step is trusted on this one down to here.
LEAST_GUESS = 1e-2


class Iterate(NamedTuple):
    """The state of an iteration."""

    x: PyTree[Array]
    change: Float[Array, ""]  # the norm of the last change, in units of the tolerance
    rate: Float[Array, ""]  # by which factor a change is smaller than the one before
    passes: Int[Array, ""]
    converged: Bool[Array, ""]
    hopeless: Bool[Array, ""]


def iterate(
    update: Callable[[PyTree[Array]], tuple[PyTree[Array], Float[Array, ""]]],
    start: PyTree[Array],
    rate: Float[Array, ""],
    *,
    limit: float,
    floor: Float[Array, ""],
    max_steps: int,
) -> Iterate:
    """Repeats ``update``, which returns the next iterate and the norm of its change.

    Hairer & Wanner (1996), section IV.8: with the rate Θ = |Δₖ|/|Δₖ₋₁| the remaining error is about Θ/(1 − Θ) |Δₖ|; the
    iteration ends when that is below ``limit`` or the change is below ``floor``, the level of rounding, and it is given
    up when the rate is too slow to get there in ``max_steps``. Before there are two changes, ``rate`` is used as the
    rate. A change of NaN ends it at once.
    """

    root = jnp.sqrt(rate)
    fourth = jnp.sqrt(root)
    # ϑ^0.8 to a hundredth of its logarithm, by roots: a library's power costs more than a small step.
    guessed = jnp.maximum(root * fourth * jnp.sqrt(jnp.sqrt(fourth)), LEAST_GUESS)
    # The remaining error over the change, where there is only a guess.
    share = guessed / jnp.maximum(1 - guessed, 1e-3)

    def body(at: Iterate) -> Iterate:
        x, change = update(at.x)
        first = at.passes == 0
        rate = jnp.where(first, guessed, change / at.change)
        left = max_steps - 1 - at.passes
        remaining = change * jnp.where(first, share, change / jnp.maximum(at.change - change, 1e-3 * at.change))
        converged = (remaining <= limit) & (rate < 1) | (change <= floor)
        too_slow = (rate >= 1) | (remaining * _power(rate, left, max_steps) > limit)
        hopeless = ~converged & (~jnp.isfinite(change) | ~first & too_slow | (left == 0))
        return Iterate(x, change, rate, at.passes + 1, converged, hopeless)

    start = Iterate(start, jnp.ones_like(floor), rate, jnp.asarray(0), jnp.asarray(False), jnp.asarray(False))
    return jax.lax.while_loop(lambda at: ~at.converged & ~at.hopeless, body, start)


def _power(base: Float[Array, ""], exponent: Int[Array, ""], largest: int) -> Float[Array, ""]:
    """``base`` to a whole number from 0 to ``largest``, by products: a library's power costs more than a small step."""
    power, square = jnp.ones_like(base), base
    for bit in range(largest.bit_length()):
        power = jnp.where((exponent >> bit) & 1 == 1, power * square, power)
        square = square * square
    return power
