"""The largest values that functions of the state take within the steps of a solve."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .masks import differentiated_where, without_derivatives
from .sampling import NARROWER, place_of_largest, sampling
from .steps import Steps

ROUNDS = 1
ITERATIONS = 6

Values = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " k"]]
Field = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " size"]]


def maxima(
    steps: Steps, values: Values, field: Field, kinks: Float[Array, " kinks"], k: int
) -> tuple[Float[Array, " k"], Float[Array, "k size"]]:
    """When each of k functions ``values(t, x)`` is largest, and the vector of the state then.

    Each step is looked at in five places, and where the quartic through them is largest, a quartic in a narrower
    window says where the maximum is, to a hundredth of the step. There the rate of the function along the motion,
    with ẋ by ``field``, is solved for its zero: the place of a largest value is good to half the digits, that of a
    zero to all.

    ``values`` of times and vectors have the right first derivatives. Within a step times have none: there a maximum
    does not change to first order as its place does. At the end of a step, where a function may be largest because it
    jumps at one of ``kinks`` or because the run ends, times move with the kink or the end.
    """
    values = eqx.filter_closure_convert(values, steps.start[0], steps.state(jnp.asarray(0), steps.start[0]))
    fixed, fixed_values, fixed_field = without_derivatives((steps, values, field))
    samples = jnp.moveaxis(fixed.samples(fixed_values, (k,)), -1, 0)
    samples = jnp.where(fixed.taken[None, :, None], samples, -jnp.inf)
    index, times = _best_place(fixed, samples)

    def each(function: Values, times: Float[Array, " k"]) -> Float[Array, " k"]:
        def one(j, found):
            return found.at[j].set(function(times[j], fixed.state(index[j], times[j]))[j])

        return jax.lax.fori_loop(0, k, one, jnp.zeros_like(times))

    def rates(t, x):
        return jax.jvp(fixed_values, (t, x), (jnp.ones_like(t), fixed_field(t, x)))[1]

    first, last = fixed.start[index], fixed.end[index]
    length = last - first
    times = place_of_largest(lambda t: each(fixed_values, t), times, length * NARROWER, first, last, ROUNDS)
    half = length * NARROWER ** (ROUNDS + 1)
    times = _stationary(lambda t: each(rates, t), times, half, first, last)
    times = jax.lax.stop_gradient(times)
    return jax.vmap(lambda i, t: _moved(steps, field, kinks, i, t))(index, times)


def _best_place(steps: Steps, samples: Float[Array, "k steps nodes"]) -> tuple[Array, Array]:
    """In which step, and when in it, quartics through samples are largest."""
    at = sampling()
    finite = jnp.all(jnp.isfinite(samples), axis=-1, keepdims=True)
    # Where a value is infinite, no polynomial says more than the samples do.
    fine = at.polynomials(jnp.where(finite, samples, 0.0))
    fine = jnp.where(finite, fine, jnp.max(samples, axis=-1, keepdims=True)).reshape(samples.shape[0], -1)
    best = jnp.argmax(fine, axis=1)
    index, place = best // at.fractions.size, best % at.fractions.size
    length = steps.end[index] - steps.start[index]
    return index, steps.start[index] + length * jnp.asarray(at.fractions, length.dtype)[place]


def _stationary(
    rates: Callable[[Float[Array, " k"]], Float[Array, " k"]],
    times: Float[Array, " k"],
    half: Float[Array, " k"],
    first: Float[Array, " k"],
    last: Float[Array, " k"],
) -> Float[Array, " k"]:
    """The zeros of ``rates`` within ``half`` of ``times``, by the Illinois method.

    Where a rate does not change from positive to negative, the function is largest at ``first`` or ``last`` if the
    window ends there; otherwise that time is kept.
    """
    low, high = jnp.maximum(times - half, first), jnp.minimum(times + half, last)
    at_low, at_high = rates(low), rates(high)
    smooth = (at_low > 0) & (at_high < 0)

    def improve(_, carry):
        (a, of_a), (b, of_b) = carry
        t = b - of_b * (b - a) / jnp.where(of_b == of_a, 1.0, of_b - of_a)
        t = jnp.where((t - a) * (t - b) < 0, t, b)
        of_t = rates(t)
        crossed, done = (of_t > 0) != (of_b > 0), (t == b) | (of_t == 0)
        far, of_far = jnp.where(crossed, b, a), jnp.where(crossed, of_b, of_a / 2)
        return (jnp.where(done, t, far), jnp.where(done, of_t, of_far)), (t, of_t)

    zero = jax.lax.fori_loop(0, ITERATIONS, improve, ((low, at_low), (high, at_high)))[1][0]
    falls, rises = (low == first) & (at_low <= 0), (high == last) & (at_high >= 0)
    return jnp.where(smooth, zero, jnp.where(falls, first, jnp.where(rises, last, times)))


def _moved(steps: Steps, field: Field, kinks: Float[Array, " kinks"], i, t) -> tuple[Array, Array]:
    """A time in a step and the vector then, with the derivatives of the kink or the end of the step that it is at."""
    taken = steps.taken[i]
    step, (start, end), kinks = differentiated_where(taken, (steps.step(i), steps.ends(i), kinks))
    x = step.evaluate(t)
    near = 16 * jnp.finfo(t.dtype).eps * jnp.maximum(jnp.abs(t), 1.0)

    def change(of: Array) -> Array:
        """Zero, with the derivative of ``of``."""
        return of - jax.lax.stop_gradient(of)

    at_kink = jnp.abs(jax.lax.stop_gradient(kinks) - t) <= near
    kink = jnp.sum(jnp.where(at_kink & (jnp.cumsum(at_kink) == 1), change(kinks), 0.0))
    at_end = jnp.where(t == steps.end[i], change(end), jnp.where(t == steps.start[i], change(start), 0.0))
    edge = (t == steps.start[i]) | (t == steps.end[i])
    move = jnp.where(edge & jnp.any(at_kink), kink, jnp.where(edge, at_end, 0.0))
    return t + move, x + move * jax.lax.stop_gradient(field(t, x))
