"""The largest values that functions of the state take within the steps of a solve."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .sampling import NARROWER, place_of_largest, sampling
from .steps import Steps

ROUNDS = 4

Values = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " k"]]


def maxima(steps: Steps, values: Values, k: int) -> tuple[Float[Array, " k"], Float[Array, "k size"]]:
    """When each of k functions ``values(t, x)`` is largest, and the vector of the state then.

    Each step is looked at in five places; in the step where the quartic through them is largest, the maximum is
    looked for in narrower and narrower windows. Its place is no more accurate than the dense output, and its value,
    which is flat there, much more. Times have no derivatives and vectors do, so that ``values`` of both have the
    right ones: a maximum does not change to first order as its place does.
    """
    fixed, at = jax.lax.stop_gradient(steps), sampling()
    samples = jnp.moveaxis(fixed.samples(values, (k,)), -1, 0)
    samples = jnp.where(fixed.taken[None, :, None], samples, -jnp.inf)
    finite = jnp.all(jnp.isfinite(samples), axis=-1, keepdims=True)
    # Where a value is infinite, no polynomial says more than the samples do.
    fine = at.polynomials(jnp.where(finite, samples, 0.0))
    fine = jnp.where(finite, fine, jnp.max(samples, axis=-1, keepdims=True)).reshape(k, -1)
    best = jnp.argmax(fine, axis=1)
    index, place = best // at.fractions.size, best % at.fractions.size
    length = fixed.end[index] - fixed.start[index]
    times = fixed.start[index] + length * jnp.asarray(at.fractions, length.dtype)[place]

    def each(times: Float[Array, " k"]) -> Float[Array, " k"]:
        def one(j, found):
            return found.at[j].set(values(times[j], fixed.state(index[j], times[j]))[j])

        return jax.lax.fori_loop(0, k, one, jnp.zeros_like(times))

    first, last = fixed.start[index], fixed.end[index]
    times = place_of_largest(each, times, length * NARROWER, first, last, ROUNDS)
    times = jax.lax.stop_gradient(times)
    return times, jax.vmap(steps.state)(index, times)
