"""The largest values that functions of the state take within the steps of a solve."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...numerics.bracketing import Sample, between, other_end
from ...numerics.masks import differentiated_where, without_derivatives
from .sampling import NARROWER, sampling
from .steps import Steps

# Evaluations: at the ends of a window, at those of one in the next step, and in the Illinois method.
ENDS, BEYOND, ITERATIONS = 2, 2, 7

Values = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " k"]]
Field = Callable[[Float[Array, ""], Float[Array, " size"]], Float[Array, " size"]]


class _Point(NamedTuple):
    """A time in each of the k steps that are looked at, and the function and its rate there."""

    time: Float[Array, " k"]
    value: Float[Array, " k"]
    rate: Float[Array, " k"]


def maxima(
    steps: Steps, values: Values, field: Field, kinks: Float[Array, " kinks"], k: int
) -> tuple[Float[Array, " k"], Float[Array, "k size"]]:
    """When each of k functions ``values(t, x)`` is largest, and the vector of the state then.

    Each step is looked at in five places. Around the place where the quartic through them is largest, or at the
    beginning of the next step where the function still grows there, its rate along the motion, with ẋ by ``field``, is
    solved for its zero: the place of a largest value is good to half the digits, that of a zero to all.

    ``values`` of times and vectors have the right first derivatives. Within a step times have none: there a maximum
    does not change to first order as its place does. At the end of a step, where a function may be largest because it
    jumps at one of ``kinks`` or because the run ends, times move with the kink or the end.
    """
    values = eqx.filter_closure_convert(values, steps.start[0], steps.state(jnp.asarray(0), steps.start[0]))
    fixed, fixed_values, fixed_field = without_derivatives((steps, values, field))
    samples = jnp.moveaxis(fixed.samples(fixed_values, (k,)), -1, 0)
    samples = jnp.where(fixed.taken[None, :, None], samples, -jnp.inf)

    def at(index: Int[Array, " k"], times: Float[Array, " k"]) -> _Point:
        def one(j, results):
            t = times[j]
            x = fixed.state(index[j], t)
            value, rate = jax.jvp(fixed_values, (t, x), (jnp.ones_like(t), fixed_field(t, x)))
            return results.at[:, j].set(jnp.stack([value[j], rate[j]]))

        return _Point(times, *jax.lax.fori_loop(0, k, one, jnp.zeros((2, k), times.dtype)))

    index, times = _stationary(fixed, at, *_best_place(fixed, samples))
    return jax.vmap(lambda i, t: _moved(steps, kinks, i, t))(index, jax.lax.stop_gradient(times))


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
    steps: Steps,
    at: Callable[[Int[Array, " k"], Float[Array, " k"]], _Point],
    index: Int[Array, " k"],
    times: Float[Array, " k"],
) -> tuple[Int[Array, " k"], Float[Array, " k"]]:
    """The steps and times near those given at which rates are zero, by the Illinois method.

    Where a rate does not change from positive to negative, the function is largest at an end of the step if the window
    ends there; otherwise the time is kept. All evaluations are made by one loop, because each copy of a long formula
    takes XLA as long to compile.
    """

    def window(index, times):
        half = (steps.end[index] - steps.start[index]) * NARROWER
        return jnp.maximum(times - half, steps.start[index]), jnp.minimum(times + half, steps.end[index])

    def choose(pick, new, old):
        return jax.tree.map(lambda new, old: jnp.where(pick, new, old), new, old)

    def advance(n, carry):
        index, moved, a, b, smooth = carry
        first, last = steps.start[index], steps.end[index]
        # The step into which the function goes on growing.
        beyond = jnp.where((b.time == last) & (b.rate > 0), 1, jnp.where((a.time == first) & (a.rate < 0), -1, 0))
        near = jnp.clip(index + beyond, 0, jnp.maximum(steps.count - 1, 0))
        edge = jnp.where(beyond == 1, steps.start[near], steps.end[near])
        old_end, new_end = Sample(a.time, a.rate), Sample(b.time, b.rate)
        low, high = window(index, jnp.where(moved == 1, first, jnp.where(moved == -1, last, times)))
        other = jnp.where(moved == -1, low, high)
        time = jnp.select([n == 0, n == 1, n == 2, n == 3], [low, high, edge, other], between(old_end, new_end))
        new = at(jnp.where(n == 2, near, index), time)
        # A function that jumps down at the end of a step is largest there.
        old = jnp.where(beyond == 1, b.value, a.value)
        goes_on = (n == 2) & (near != index) & (new.value >= old - 1e-9 * jnp.maximum(jnp.abs(old), 1.0))
        moved = jnp.where(goes_on, beyond, moved)
        index = jnp.where(goes_on, near, index)
        kept = other_end(old_end, new_end, Sample(new.time, new.rate))
        solving = (n > 3) & smooth & (new.time != b.time)
        to_a = (n == 0) | goes_on & (moved == 1) | (n == 3) & (moved == -1)
        to_b = (n == 1) | goes_on & (moved == -1) | (n == 3) & (moved != -1) | solving
        a = a._replace(time=jnp.where(solving, kept.x, a.time), rate=jnp.where(solving, kept.f, a.rate))
        a, b = choose(to_a, new, a), choose(to_b, new, b)
        return index, moved, a, b, jnp.where(n == 3, (a.rate > 0) & (b.rate < 0), smooth)

    nothing = _Point(times, jnp.zeros_like(times), jnp.zeros_like(times))
    begin = (index, jnp.zeros_like(index), nothing, nothing, jnp.zeros(index.shape, bool))
    index, moved, a, b, smooth = jax.lax.fori_loop(0, ENDS + BEYOND + ITERATIONS, advance, begin)
    first, last = steps.start[index], steps.end[index]
    kept = jnp.where(moved == 1, first, jnp.where(moved == -1, last, times))
    falls, rises = (a.time == first) & (a.rate <= 0), (b.time == last) & (b.rate >= 0)
    return index, jnp.where(smooth, b.time, jnp.where(falls, first, jnp.where(rises, last, kept)))


def _moved(steps: Steps, kinks: Float[Array, " kinks"], i, t) -> tuple[Array, Array]:
    """A time in a step and the vector then, with the derivatives of the kink or the end of the step that it is at."""
    taken = steps.taken[i]
    step, (start, end), kinks = differentiated_where(taken, (steps.step(i), steps.ends(i), kinks))
    near = 16 * jnp.finfo(t.dtype).eps * jnp.maximum(jnp.abs(t), 1.0)

    def change(of: Array) -> Array:
        """Zero, with the derivative of ``of``."""
        return of - jax.lax.stop_gradient(of)

    at_kink = jnp.abs(jax.lax.stop_gradient(kinks) - t) <= near
    kink = jnp.sum(jnp.where(at_kink & (jnp.cumsum(at_kink) == 1), change(kinks), 0.0))
    at_end = jnp.where(t == steps.end[i], change(end), jnp.where(t == steps.start[i], change(start), 0.0))
    edge = (t == steps.start[i]) | (t == steps.end[i])
    move = jnp.where(edge & jnp.any(at_kink), kink, jnp.where(edge, at_end, 0.0))
    return t + move, step.evaluate(t + move)
