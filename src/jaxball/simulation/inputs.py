"""Sees what drives a run from outside before it begins, and limits the steps where that varies fast, for ``simulate``.

Steps are chosen by the error of the state. A state that rests has none, and so a step may pass over a push that comes
late: at none of the few times at which the step evaluates the field is there anything to be seen. Therefore the inputs
that ``numerics.time_inputs`` finds are sampled over the whole run, and where no polynomial follows the samples of a
stretch, to the tolerance relative to how much an input varies in the run, no step is as long as that stretch. A part
in which not even the shortest stretches are followed is sampled once more. Inputs that depend on the state as well are
those of the state at the start.

The samples are equally spaced. A window of n + 1 of them is followed if the Chebyshev coefficient of order n of the
polynomial through them, which their n-th difference tells, is small. Long windows have every 16th, 8th, … sample. n is
16, so that a step whose own error resolves a function is hardly ever found too long.

A push exp(−(t/w)²) with w 1/1000 of the run is seen whatever else there is, and a single one of 1/10,000, too.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, UInt32

from ..numerics.time_inputs import find_inputs
from ..programs.batches import fill_vectors
from ..programs.derivatives.differentiation import without_derivatives
from .solvers.multistep import AbstractMultistep
from .solvers.wrapping import AbstractWrappingController

INTERVALS = 256  # between samples
CELLS = 32  # parts of the samples in each of which the longest step is the same; a number has a bit for each
HIGHEST = 16  # order
VISIBLE = 1e-3  # of a function's variation: what a step can tell from nothing
LEAST_VARIATION = 64  # roundings of a function's size
# The samples lie a little within the run, so that what repeats in a round part of it does not look constant. The last
# one is repeated, so that they fill vectors, which natively takes a third of the time.
PLACES = np.pad(np.linspace(0.0031, 0.9973, INTERVALS + 1), (0, 7), mode="edge")
ENOUGH = 8  # the order of a method that takes the longest steps


class _Window(NamedTuple):
    """A stretch of ``order`` + 1 samples, every ``stride``-th one.

    Where a function varies more within it than a polynomial, steps are no ``longest`` intervals long.
    """

    order: int
    stride: int
    longest: int

    @property
    def number(self) -> int:
        """How many there are, each a stride after the one before."""
        return INTERVALS // self.stride - self.order + 1

    @property
    def weights(self) -> list[float]:
        """What takes the samples to the Chebyshev coefficient of the order, (n/4)ⁿ 2/n! times the n-th difference."""
        n = self.order
        size = 2 * (n / 4) ** n / math.factorial(n)
        return [(-1) ** k * math.comb(n, k) * size for k in range(n + 1)]

    @property
    def cells(self) -> np.ndarray:
        """The cells into which each of them reaches, one bit for each."""
        first = np.arange(self.number) * self.stride
        last = first + self.order * self.stride
        starts = np.arange(CELLS) * (INTERVALS // CELLS)
        ends = starts + INTERVALS // CELLS
        reaches = (first[:, None] < ends) & (starts < last[:, None])
        return np.sum(reaches << np.arange(CELLS), axis=1).astype(np.uint32)

    def failing(
        self,
        samples: Float[Array, "samples k"],
        breaks: Int[Array, " samples"] | None,
        most: Float[Array, " k"],
    ) -> UInt32[Array, ""]:
        """Returns the cells in which a function is not followed, because a coefficient is larger than ``most``."""
        samples, count = samples[:: self.stride], self.number
        coefficients = sum(weight * samples[k : k + count] for k, weight in enumerate(self.weights))
        fails = jnp.any(jnp.abs(coefficients) > most[None], axis=1)
        if breaks is not None:
            breaks = breaks[:: self.stride]
            fails &= breaks[self.order : self.order + count] == breaks[:count]
        return jax.lax.reduce(jnp.where(fails, self.cells, 0), np.uint32(0), jax.lax.bitwise_or, (0,))


# The short windows tell how much shorter the steps must be where the shortest one of the highest order is not followed.
LONG = tuple(_Window(HIGHEST, stride, 8 * stride) for stride in (16, 8, 4, 2, 1))
SHORT = (_Window(8, 1, 4), _Window(4, 1, 1))


class Range(NamedTuple):
    """The extreme values of functions, as far as they are known."""

    least: Float[Array, " k"]
    largest: Float[Array, " k"]

    @classmethod
    def none(cls, of: Any) -> "Range":
        """Returns that of no samples of functions with values of this shape and type."""
        no = jnp.full(of.shape, jnp.inf, of.dtype)
        return cls(no, -no)

    def including(self, samples: Float[Array, "samples k"]) -> "Range":
        """Returns the extreme values of these samples, too."""
        return Range(
            jnp.minimum(self.least, jnp.min(samples, axis=0)), jnp.maximum(self.largest, jnp.max(samples, axis=0))
        )

    def share(self, of: Float[Array, ""]) -> Float[Array, " k"]:
        """Returns a part of how much each function varies; at least what rounding makes of its size."""
        size = jnp.maximum(jnp.abs(self.least), jnp.abs(self.largest))
        rounding = LEAST_VARIATION * float(jnp.finfo(size.dtype).eps) * size
        return jnp.maximum(of * (self.largest - self.least), rounding)


def failing_windows(
    samples: Float[Array, "samples k"],
    breaks: Int[Array, " samples"] | None,
    extent: Range,
    tolerance: Float[Array, ""],
) -> UInt32[Array, " kinds"]:
    """Returns the cells in which each kind of window is not followed, as bits.

    ``samples`` may have more rows than those that count.

    - ``breaks``: how many jumps there are before each sample; None without any. Steps end at them, so that a window
      across one tells nothing.
    - ``extent``: of the functions, to which the ``tolerance`` is relative.
    """
    small = extent.share(tolerance)
    failing = [window.failing(samples, breaks, small) for window in LONG]

    def look_closer(last: UInt32[Array, ""]) -> list[UInt32[Array, ""]]:
        shorter, visible = [last], extent.share(jnp.maximum(tolerance, VISIBLE))
        for window in SHORT:
            shorter.append(shorter[-1] & window.failing(samples, breaks, visible))
        return shorter[1:]

    none = [jnp.zeros_like(failing[-1])] * len(SHORT)
    return jnp.stack(failing + jax.lax.cond(failing[-1] > 0, look_closer, lambda last: none, failing[-1]))


def in_cell(failing: UInt32[Array, " kinds"], cell: Int[Array, ""]) -> Bool[Array, " kinds"]:
    """Returns which kinds of windows are not followed in a cell."""
    return failing & (np.uint32(1) << cell.astype(np.uint32)) > 0


def longest_step(failing: Bool[Array, " kinds"]) -> Float[Array, ""]:
    """Returns the longest step where these kinds of windows are not followed, in intervals; infinite without any."""
    longest = jnp.asarray(jnp.inf)
    for k, window in enumerate(LONG + SHORT):
        longest = jnp.where(failing[k], window.longest, longest)
    return longest


def extent_of(cells: UInt32[Array, ""]) -> tuple[Int[Array, ""], Int[Array, ""]]:
    """Returns the first of some cells, and the one after the last; the first is beyond all if there are none."""
    place = np.arange(CELLS)
    inside = (cells >> place.astype(np.uint32)) & 1 > 0
    return jnp.min(jnp.where(inside, place, CELLS)), jnp.max(jnp.where(inside, place + 1, 0))


class StepLimits(eqx.Module):
    """How long steps may be: in each of the equal cells of a run, and of a part of it that is looked at more closely.

    - ``spans``: the run and the part, start and end; a part that there is not has no length.
    - ``failing``: the cells in which windows of each kind are not followed.
    - ``shortest``: a step that may be taken anywhere.
    - ``share``: that of a solver.
    """

    spans: Float[Array, "2 2"]
    failing: UInt32[Array, "2 kinds"]
    shortest: Float[Array, ""]
    share: float = eqx.field(static=True)

    @classmethod
    def of(cls, spans: Float[Array, "2 2"], failing: UInt32[Array, "2 kinds"], share: float) -> "StepLimits":
        """Finds the shortest of all steps."""
        intervals = (spans[:, 1] - spans[:, 0]) * (share / INTERVALS)
        run, part = (longest_step(of > 0).astype(spans.dtype) for of in failing)
        # Where there is no part, its length is 0.
        shortest = jnp.minimum(run * intervals[0], jnp.where(jnp.isfinite(part), part * intervals[1], jnp.inf))
        return cls(spans, failing, shortest, share)

    def end_of(self, t: Float[Array, ""], end: Float[Array, ""]) -> Float[Array, ""]:
        """Returns where a step from ``t`` to ``end`` must end: it may touch no cell in which it is too long."""
        look = jnp.where((self.spans[1, 0] <= t) & (t < self.spans[1, 1]), 1, 0)
        (first, last), failing = self.spans[look], self.failing[look]
        width, interval = (last - first) / CELLS, (last - first) * (self.share / INTERVALS)
        cell = jnp.clip(((t - first) / width).astype(int), 0, CELLS - 1)

        def edge(cell: Int[Array, ""]) -> Float[Array, ""]:
            return first + cell.astype(t.dtype) * width

        def go_on(carry: tuple[Array, Array]) -> tuple[Array, Array]:
            cell, end = carry
            longest = longest_step(in_cell(failing, cell)).astype(t.dtype) * interval
            return cell + 1, jnp.minimum(end, jnp.maximum(edge(cell), t + longest))

        def is_touched(carry: tuple[Array, Array]) -> Bool[Array, ""]:
            cell, end = carry
            return (cell < CELLS) & (edge(cell) < end)

        # What follows the part is looked at less closely, and not within the same step.
        most = jnp.where(look == 1, jnp.maximum(last, t + interval), jnp.inf)
        return jax.lax.while_loop(is_touched, go_on, (cell, jnp.minimum(end, most)))[1]


class LimitedSteps(AbstractWrappingController):
    """The steps of ``controller``, none longer than ``limits`` allow."""

    controller: diffrax.AbstractAdaptiveStepSizeController  # pyright: ignore[reportIncompatibleVariableOverride]
    limits: StepLimits

    def __init__(self, controller: diffrax.AbstractAdaptiveStepSizeController, limits: StepLimits):
        self.controller, self.limits = controller, limits

    def init(self, terms, t0: Any, t1: Any, y0, dt0, args, func, error_order):
        end, state = self.controller.init(terms, t0, t1, y0, dt0, args, func, error_order)
        return self.limit(t0, end), state

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        keep, start, end, jumped, state, result = self.controller.adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state
        )
        return keep, start, self.limit(start, end), jumped, state, result

    def limit(self, start: Any, end: Any) -> Float[Array, ""]:
        """Returns the end of a step that would go from ``start`` to ``end``."""
        fixed, proposed = jax.lax.stop_gradient((start, end))
        long = proposed - fixed > self.limits.shortest
        limit = jax.lax.cond(long, lambda: self.limits.end_of(fixed, proposed), lambda: proposed)
        return jnp.where(limit < proposed, limit, end)


def share_of(solver: diffrax.AbstractSolver) -> float:
    """Returns the part of the longest step that a solver may take: less, if it evaluates the field less often in it."""
    order = 2 if isinstance(solver, AbstractMultistep) else solver.order(diffrax.ODETerm(lambda t, y, args: y))
    return min(1.0, float(order or 1) / ENOUGH)


def limits_of_steps(
    field: Callable[..., Array],
    times: Float[Array, " T"],
    x: Float[Array, " size"],
    parameters: Any,
    kinks: Float[Array, " kinks"],
    tolerance: Float[Array, ""],
    share: float,
    modes: bool,
) -> StepLimits | None:
    """Returns how long steps may be for the inputs of a field, which is a function of (t, ``x``, ``parameters``).

    ``share`` is that of the solver, ``modes`` says whether the system has any. Steps end at ``kinks``, across which no
    input is smooth. None where the field has no inputs.
    """
    inputs = find_inputs(jax.make_jaxpr(field)(times[0], x, parameters), modes)
    if inputs is None:
        return None
    times, x, parameters, kinks, tolerance = without_derivatives((times, x, parameters, kinks, tolerance))

    def sample(t: Float[Array, ""]) -> Float[Array, " inputs"]:
        values = without_derivatives(inputs(t, x, parameters))
        return jnp.where(jnp.isfinite(values), values, 0.0)

    @jax.jit  # a function of the program, which is called twice
    def look(span: Float[Array, "2"], extent: Range) -> tuple[UInt32[Array, " kinds"], Range]:
        instants = span[0] + jnp.asarray(PLACES, times.dtype) * (span[1] - span[0])
        samples = fill_vectors(sample, instants)
        breaks = jnp.sum(kinks.astype(times.dtype)[None] <= instants[:, None], axis=1) if kinks.size else None
        extent = extent.including(samples)
        return failing_windows(samples, breaks, extent, tolerance), extent

    run = jnp.stack([times[0], times[-1]])
    failing, extent = look(run, Range.none(jax.eval_shape(sample, times[0])))
    missed = failing[-1]
    first, last = (cell.astype(run.dtype) for cell in extent_of(missed))
    part = run[0] + jnp.stack([first, jnp.maximum(first, last)]) * ((run[1] - run[0]) / CELLS)
    closer = jax.lax.cond(missed > 0, lambda: look(part, extent)[0], lambda: jnp.zeros_like(failing))
    # Where it is looked at more closely, the first look only tells that no step passes over all of it.
    failing = jnp.where(np.arange(failing.size) < len(LONG), failing, failing & ~missed)
    return StepLimits.of(jnp.stack([run, part]), jnp.stack([failing, closer]), share)
