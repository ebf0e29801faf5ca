"""Finds the largest values of functions of the state, such as the contact force, within the steps of a solve."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from ...numerics.cuts import MOST_PIECES_TRIED
from ...numerics.pieces import LONGEST_PIECE
from ...programs.batches import map_rows
from ...programs.derivatives.differentiation import differentiate_where, without_derivatives
from .peaks import is_settled
from .steps import FINENESS, NARROWER, Steps, Values, sampling

# How many windows are examined in one turn, and into how many parts a window is cut that does not settle everything.
WINDOWS_AT_ONCE, PARTS_OF_WINDOW = 8, 8
WHOLE_STEP, LONGEST_STEP = (
    PARTS_OF_WINDOW**4,
    PARTS_OF_WINDOW**2,
)  # a step in units of the smallest part, and what may be too long for the run
NEGLIGIBLE_FORCE = 1e-9  # of the values in a window: what they vary by less is no peak
# The sizes of windows around the best points, relative to their steps, in successive rounds; the third ones are points.
WINDOW_SIZES = (NARROWER, NARROWER**2, 0.0, NARROWER**2)
CURVATURE_ROUND, LINES = 2, 3


class Largest(NamedTuple):
    """When each of k functions is largest, in which step, and all functions at these times.

    - ``size``: its value, a little less where one step ends and another begins, so that the next one is preferred if it
      grows there.
    - ``least``: its least value at the points evaluated, from which a constant function is recognised.
    - ``length``: of the window in which it was first found.
    - ``curvature``: its second derivative, where it is smooth.
    - ``values``: all functions at time i in row i; ``vectors`` are those of the states then, and ``rates`` theirs.
    """

    size: Float[Array, " k"]
    least: Float[Array, " k"]
    length: Float[Array, " k"]
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

    The functions are evaluated at five points of each step, and of parts of it where these points do not settle where
    they are largest. Around the best point of the quartics through them, and in the adjacent step if that point is at
    an end, windows become narrower. Finally the rate along the motion is solved
    for its zero: the location of a maximum is accurate to half the digits, that of a zero to all.

    All evaluations are in one loop, because each copy of a long formula takes as long again to compile.
    """
    steps, values = without_derivatives((steps, eqx.filter_closure_convert(values, *steps.like)))
    width, size = max(WINDOWS_AT_ONCE, 2 * k), steps.like[1].size
    nodes, shares = (jnp.asarray(x, steps.start.dtype) for x in (sampling().nodes, WINDOW_SIZES))

    def look_again(state: tuple[_Place, Array, Largest]) -> tuple[_Place, Array, Largest]:
        # First all steps, a few windows at a time; then ever narrower windows around the best points; last, the lines.
        place, r, best = state
        looking, lines = place.position < steps.count * WHOLE_STEP, r == LINES
        whole, around = place.windows(steps, width), _around(steps, best, shares[r], width)
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
        # Those behind the first window that is to be cut are looked at again.
        counts, next_place = place.advance(steps, here, _are_settled(steps, here, samples, best.size))
        samples = jnp.where((counts | ~looking)[:, None, None], samples, -jnp.inf)
        peaks = _largest(steps, here, samples, vectors, rates)
        least = jnp.where(looking, jnp.minimum(best.least, peaks.least), best.least)
        better = ~looking | ~(peaks.size <= best.size)
        peaks = jax.tree.map(lambda a, b: jnp.where(better.reshape(-1, *(1,) * (a.ndim - 1)), a, b), peaks, best)
        first_found = looking & better
        peaks = peaks._replace(
            curvature=jnp.where(~looking & (r == CURVATURE_ROUND), best.curvature, peaks.curvature),
            length=jnp.where(first_found, peaks.length, best.length),
            least=least,
        )
        exact = best._replace(time=_stationary(steps, best, here, samples[:k]))
        return next_place, r + jnp.where(looking, 0, 1), select_tree(~looking & lines, exact, peaks)

    zero = jnp.zeros(k, steps.start.dtype)
    nothing = Largest(
        size=zero - jnp.inf,
        least=zero + jnp.inf,
        length=zero,
        time=zero,
        step=jnp.zeros(k, int),
        curvature=zero,
        values=jnp.zeros((k, k), zero.dtype),
        vectors=jnp.zeros((k, size), zero.dtype),
        rates=jnp.zeros((k, size), zero.dtype),
    )
    begin = _Place(jnp.asarray(0), jnp.asarray(WHOLE_STEP), jnp.asarray(0)), jnp.asarray(0), nothing
    return jax.lax.while_loop(lambda state: state[1] < len(WINDOW_SIZES), look_again, begin)[2]


class _Place(NamedTuple):
    """What comes next of all steps: windows of a ``width`` from ``position`` on, in units of the smallest part of a
    step. ``cuts``: how many windows have been cut.
    """

    position: Int[Array, ""]
    width: Int[Array, ""]
    cuts: Int[Array, ""]

    def windows(self, steps: Steps, count: int) -> _Windows:
        """Returns the windows that come next; some of them twice, if there are fewer."""
        last = jnp.maximum(steps.count * WHOLE_STEP - self.width, 0)
        places = jnp.minimum(self.position + self._within(count) * self.width, last)
        index = places // WHOLE_STEP
        start, length = steps.start[index], steps.end[index] - steps.start[index]
        low, high = (
            (place - index * WHOLE_STEP).astype(start.dtype) / WHOLE_STEP for place in (places, places + self.width)
        )
        return _Windows(index, start + low * length, jnp.where(high < 1, start + high * length, steps.end[index]))

    def _within(self, count: int) -> Int[Array, " n"]:
        """Returns the numbers of the windows, which are whole steps or parts of one window."""
        left = (PARTS_OF_WINDOW * self.width - self.position % (PARTS_OF_WINDOW * self.width)) // self.width
        return jnp.minimum(jnp.arange(count), jnp.where(self.width == WHOLE_STEP, count, left) - 1)

    def advance(self, steps: Steps, here: _Windows, settled: Bool[Array, " n"]) -> tuple[Bool[Array, " n"], "_Place"]:
        """Returns which windows count, and the place behind them: the first one that is not ``settled`` is cut."""
        count = settled.size
        settled |= (self.width == 1) | (self.cuts >= MOST_PIECES_TRIED)
        places, numbers = jnp.arange(count), self._within(count)
        first = jnp.min(jnp.where(settled, count, places))
        counts, is_cut = places < first, first < count
        position = (
            self.position + jnp.where(is_cut, numbers[jnp.minimum(first, count - 1)], numbers[-1] + 1) * self.width
        )
        width = jnp.where(is_cut, self.width // PARTS_OF_WINDOW, self.width)
        # The next window is as long as one that begins here may be.
        while_longer = ~is_cut
        for _ in range(WHOLE_STEP.bit_length() // PARTS_OF_WINDOW.bit_length() + 1):
            longer = while_longer & (width < WHOLE_STEP) & (position % (PARTS_OF_WINDOW * width) == 0)
            width = jnp.where(longer, PARTS_OF_WINDOW * width, width)
        return counts, _Place(position, width, self.cuts + jnp.where(is_cut, 1, 0))


def _are_settled(
    steps: Steps, here: _Windows, samples: Float[Array, "n nodes k"], known: Float[Array, " k"]
) -> Bool[Array, " n"]:
    """Returns in which windows it is certain how large each function is at most, in view of ``known`` values."""
    run = steps.end[jnp.maximum(steps.count - 1, 0)] - steps.start[0]
    length = steps.end[here.step] - steps.start[here.step]
    window = here.high - here.low
    # A step may be as long as the run, where the state rests.
    short = (window <= LONGEST_PIECE * run) | (window * LONGEST_STEP <= length)
    settled = jax.vmap(lambda values: is_settled(values, known, NEGLIGIBLE_FORCE))(samples)
    return short & jnp.all(settled, axis=1)


def _around(steps: Steps, best: Largest, share: Float[Array, ""], width: int) -> _Windows:
    """Returns windows around the best points, and, in the adjacent step, at the nearer end of their steps."""
    start, end = steps.start[best.step], steps.end[best.step]
    half = share * best.length
    late = best.time - start > end - best.time
    other = jnp.clip(best.step + jnp.where(late, 1, -1), 0, jnp.maximum(steps.count - 1, 0))
    first, last = steps.start[other], steps.end[other]
    length = jnp.minimum(half, last - first)
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
        least=jnp.min(jnp.where(jnp.isneginf(curves), jnp.inf, curves), axis=(1, 2)),
        length=length,
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
