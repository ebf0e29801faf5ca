"""Finds the largest values of functions of the state, such as the contact force, within the steps of a solve."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ...numerics.arrays import select_tree
from ...programs.batches import map_rows
from ...programs.derivatives.differentiation import differentiate_where, without_derivatives
from .steps import FINENESS, NARROWER, Steps, Values, sampling

# How many windows are examined in one turn.
WINDOWS_AT_ONCE = 8
# The sizes of windows around the best points, relative to their steps, in successive rounds; the third ones are points.
WINDOW_SIZES = (NARROWER, NARROWER**2, 0.0, NARROWER**2)
CURVATURE_ROUND, LINES = 2, 3


class Largest(NamedTuple):
    """When each of k functions is largest, in which step, and all functions at these times.

    - ``size``: its value, a little less where one step ends and another begins, so that the next one is preferred if it
      grows there.
    - ``least``: its least value at the points evaluated, from which a constant function is recognised.
    - ``curvature``: its second derivative, where it is smooth.
    - ``values``: all functions at time i in row i; ``vectors`` are those of the states then, and ``rates`` theirs.
    """

    size: Float[Array, " k"]
    least: Float[Array, " k"]
    time: Float[Array, " k"]
    step: Int[Array, " k"]
    curvature: Float[Array, " k"]
    values: Float[Array, "k k"]
    vectors: Float[Array, "k size"]
    rates: Float[Array, "k size"]


class _Windows(NamedTuple):
    """Parts of steps."""

    step: Int[Array, " n"]
    low: Float[Array, " n"]
    high: Float[Array, " n"]

    def times(self, fractions: Float[Array, " m"]) -> Float[Array, "n m"]:
        """Returns the times at fractions, of which the last is the end."""
        times = self.low[:, None] + fractions[None] * (self.high - self.low)[:, None]
        return times.at[:, -1].set(self.high)


def maxima(steps: Steps, values: Values, k: int) -> Largest:
    """Finds when each of k functions is largest, as constants; :func:`move` has the derivatives of times.

    ``values(t, x)`` are these functions and then ẋ, because shared parts are computed once.

    The functions are evaluated at five points of each step. Around the best point of the quartics through them, and in
    the adjacent step if that point is at an end, windows become narrower. Finally the rate along the motion is solved
    for its zero: the location of a maximum is accurate to half the digits, that of a zero to all.

    All evaluations are in one loop, because each copy of a long formula takes as long again to compile.
    """
    steps, values = without_derivatives((steps, eqx.filter_closure_convert(values, *steps.like)))
    width, size = max(WINDOWS_AT_ONCE, 2 * k), steps.like[1].size
    rounds = -(-steps.count // width)
    nodes, shares = (jnp.asarray(x, steps.start.dtype) for x in (sampling().nodes, WINDOW_SIZES))

    def look_again(r: Int[Array, ""], best: Largest) -> Largest:
        # First all steps, ``width`` of them at a time; then ever narrower windows around the best points; last, the
        # lines.
        looking, lines = r < rounds, r == rounds + LINES
        whole, around = _whole(steps, r, width), _around(steps, best, shares[jnp.maximum(r - rounds, 0)], width)
        here = select_tree(looking, whole, around)

        def evaluate(window: Int[Array, ""], t: Float[Array, ""]) -> tuple[Array, ...]:
            index = jnp.minimum(window, k - 1)
            # In the last round along the tangent of the motion: the slope of the dense output is less accurate than its
            # values, and the zero of a rate would be off by as much.
            tangent = best.vectors[index] + (t - best.time[index]) * best.rates[index]
            x = jnp.where(lines & (window < k), tangent, steps.state(here.step[window], t))
            return x, *jnp.split(values(t, x), [k])

        def sample(window: Int[Array, ""], times: Float[Array, " nodes"]) -> tuple[Array, ...]:
            vectors, samples, rates = map_rows(evaluate, jnp.broadcast_to(window, times.shape), times)
            return samples, vectors[0], rates[0]

        samples, vectors, rates = map_rows(sample, jnp.arange(width), here.times(nodes))
        peaks = _largest(steps, here, samples, vectors, rates)
        least = jnp.where(looking, jnp.minimum(best.least, peaks.least), best.least)
        better = ~looking | ~(peaks.size <= best.size)
        peaks = jax.tree.map(lambda a, b: jnp.where(better.reshape(-1, *(1,) * (a.ndim - 1)), a, b), peaks, best)
        peaks = peaks._replace(curvature=jnp.where(r == rounds + CURVATURE_ROUND, best.curvature, peaks.curvature))
        peaks = peaks._replace(least=least)
        exact = best._replace(time=_stationary(steps, best, here, samples[:k]))
        return select_tree(lines, exact, peaks)

    zero = jnp.zeros(k, steps.start.dtype)
    nothing = Largest(
        size=zero - jnp.inf,
        least=zero + jnp.inf,
        time=zero,
        step=jnp.zeros(k, int),
        curvature=zero,
        values=jnp.zeros((k, k), zero.dtype),
        vectors=jnp.zeros((k, size), zero.dtype),
        rates=jnp.zeros((k, size), zero.dtype),
    )
    return jax.lax.fori_loop(0, rounds + len(WINDOW_SIZES), look_again, nothing)


def _whole(steps: Steps, r: Int[Array, ""], width: int) -> _Windows:
    """Returns windows that are the next steps, whole."""
    index = jnp.minimum(r * width + jnp.arange(width), jnp.maximum(steps.count - 1, 0))
    return _Windows(index, steps.start[index], steps.end[index])


def _around(steps: Steps, best: Largest, share: Float[Array, ""], width: int) -> _Windows:
    """Returns windows around the best points, and, in the adjacent step, at the nearer end of their steps."""
    start, end = steps.start[best.step], steps.end[best.step]
    half = share * (end - start)
    late = best.time - start > end - best.time
    other = jnp.clip(best.step + jnp.where(late, 1, -1), 0, jnp.maximum(steps.count - 1, 0))
    first, last = steps.start[other], steps.end[other]
    length = share * (last - first)
    inner = _Windows(best.step, jnp.maximum(best.time - half, start), jnp.minimum(best.time + half, end))
    beyond = _Windows(other, jnp.where(late, first, last - length), jnp.where(late, first + length, last))
    # The padding has no effect.
    filled = width - 2 * best.time.size
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b, jnp.repeat(a[:1], filled)]), inner, beyond)


def _largest(
    steps: Steps,
    here: _Windows,
    samples: Float[Array, "n nodes k"],
    vectors: Float[Array, "n size"],
    rates: Float[Array, "n size"],
) -> Largest:
    """Finds where the quartics through samples are largest in windows; where a sample is not finite, the largest sample
    counts.
    """
    grid, k = sampling(), samples.shape[2]
    curves = jnp.transpose(samples, (2, 0, 1))
    finite = jnp.all(jnp.isfinite(curves), axis=-1, keepdims=True)
    fine = grid.polynomials(jnp.where(finite, curves, 0.0))
    fine = jnp.where(finite, fine, jnp.max(curves, axis=-1, keepdims=True))
    fractions = jnp.asarray(grid.fractions, samples.dtype)
    times = here.times(fractions)
    ends = (times == steps.start[here.step][:, None]) | (times == steps.end[here.step][:, None])
    # At the ends of the run there is no next step to prefer.
    ends &= (times != steps.start[0]) & (times != steps.end[jnp.maximum(steps.count - 1, 0)])
    sizes = fine - jnp.where(ends, 1e-9 * jnp.maximum(jnp.abs(fine), 1.0), 0.0)
    # A value that is not a number must not be passed over in silence: it counts as the largest.
    sizes = jnp.where(jnp.isnan(sizes), jnp.inf, sizes).reshape(k, -1)
    size, places = jnp.max(sizes, axis=1), jnp.arange(sizes.shape[1])
    # The first index of the largest, without argmax, at which XLA's CPU compiler fails in a loop.
    place = jnp.min(jnp.where(sizes == size[:, None], places, places.size - 1), axis=1)
    window, p = place // fractions.size, place % fractions.size
    length = (here.high - here.low)[window]
    slope, bend = grid.rates(jnp.where(finite, curves, 0.0)[jnp.arange(k), window], fractions[p])
    # A Newton step to the zero of the slope, except at the ends.
    smooth = (p > 0) & (p < fractions.size - 1) & (bend < 0)
    change = jnp.clip(jnp.where(smooth, -slope / jnp.where(smooth, bend, 1.0), 0.0), -1 / FINENESS, 1 / FINENESS)
    return Largest(
        size=size,
        least=jnp.min(curves, axis=(1, 2)),
        time=times[window, p] + change * length,
        step=here.step[window],
        curvature=jnp.where(smooth, bend / jnp.where(smooth, length, 1.0) ** 2, 0.0),
        values=samples[window, 0],
        vectors=vectors[window],
        rates=rates[window],
    )


def _stationary(steps: Steps, best: Largest, here: _Windows, samples: Float[Array, "k nodes k"]) -> Float[Array, " k"]:
    """Returns the best times after a Newton step, with the slopes of samples along tangents of the motion."""
    k = best.time.size
    low, length = here.low[:k], (here.high - here.low)[:k]
    smooth = (best.curvature < 0) & (length > 0)
    width = jnp.where(smooth, length, 1.0)
    slope, _ = sampling().rates(samples[jnp.arange(k), :, jnp.arange(k)], (best.time - low) / width)
    time = best.time - slope / (width * jnp.where(smooth, best.curvature, 1.0))
    time = jnp.clip(time, steps.start[best.step], steps.end[best.step])
    return jnp.where(smooth & jnp.isfinite(time), time, best.time)


def move(
    steps: Steps, kinks: Float[Array, " kinks"], i: Int[Array, ""], t: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, " size"]]:
    """Gives a time in a step, and the vector then, the derivatives of the kink or the end of the step that it is at.

    Within a step times have none: there the maximum does not change to first order with its location. At the end of a
    step, where a function may be largest because it jumps at one of ``kinks`` or because the run ends, times move with
    the kink or the end.
    """
    valid = steps.taken[i]
    step, (start, end), kinks = differentiate_where(valid, (steps.step(i), steps.ends(i), kinks))
    near = 16 * jnp.finfo(t.dtype).eps * jnp.maximum(jnp.abs(t), 1.0)

    def change(of: Array) -> Array:
        """Returns zero, with the derivative of ``of``."""
        return of - jax.lax.stop_gradient(of)

    at_kink = jnp.abs(jax.lax.stop_gradient(kinks) - t) <= near
    kink = jnp.sum(jnp.where(at_kink & (jnp.cumsum(at_kink) == 1), change(kinks), 0.0))
    at_end = jnp.where(t == steps.end[i], change(end), jnp.where(t == steps.start[i], change(start), 0.0))
    edge = (t == steps.start[i]) | (t == steps.end[i])
    move = jnp.where(edge & jnp.any(at_kink), kink, jnp.where(edge, at_end, 0.0))
    return t + move, step.evaluate(t + move)
