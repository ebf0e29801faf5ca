"""The Adams methods of variable order and step."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from ...numerics.arrays import select_tree
from .base import RESULTS, FlatProblem, at_limit, flat_problem
from .differences import Points, adams_error_constants, fold, sums, unfold
from .interpolation import AdamsPolynomial
from .multistep import EQUAL, AbstractMultistep, AdamsController, Plan, check_order
from .stages import FROM_CONTROLLER

# The target error of a step, relative to the tolerance. With STEP's own 0.5 a run takes 7 % fewer evaluations and has
# an error three to four times as large: the same work for a given error, but less control by the tolerance, and more
# rejected steps.
TARGET = 0.1
MOST_SHRUNK = 1e-4


def plan(
    size: Float[Array, ""],
    errors: Float[Array, "4"],
    order: Int[Array, ""],
    equal: Int[Array, ""],
    rising: Bool[Array, ""],
    highest: int,
) -> tuple[Plan, Bool[Array, ""]]:
    """Returns the plan after a step, and whether the run is still starting, its order and its step growing from step to
    step.

    **Arguments:**

    - ``size``: the error of the step, in units of the tolerance.
    - ``errors``: those of the formulas of order k − 2 to k + 1, with k that of the step, if all steps had the length of
      this one; those beyond the available points mean nothing.
    - ``order``: that of the step, k, and ``highest`` the highest available.
    - ``equal``: how many steps, this one included, had the same length. The error of order k + 1 is trusted after
      k + 1 of them.
    - ``rising``: whether it was starting.
    """
    k = order
    lowest, lower, here, higher = errors
    falls = jnp.where(k > 2, jnp.maximum(lower, lowest) <= here, (k == 2) & (lower <= 0.5 * here))
    rising = rising & ~falls & (k < highest)
    judged = ~rising & ~falls & (equal > k) & (k < highest)
    falls |= judged & (k > 1) & (lower <= jnp.minimum(here, higher))
    rises = judged & ~falls & (higher < jnp.where(k == 1, 0.5 * here, here))
    new = jnp.where(falls, k - 1, jnp.where(rises | rising, k + 1, k))
    error = jnp.where(falls, lower, jnp.where(rises, higher, here))
    doubled = rising | (error * (1 << (new + 1)).astype(error.dtype) <= TARGET)

    def shorten() -> tuple[Float[Array, ""], Float[Array, ""]]:
        factor = jnp.where(error <= TARGET, 1.0, jnp.clip(_ratio(error, new), 0.5, 0.9))
        shrink = jnp.clip(_ratio(here, k), MOST_SHRUNK, 0.5)
        return factor, jnp.where(jnp.isfinite(here), shrink, 0.1)

    # Most steps are accepted and followed by one as long or twice as long, and powers cost as much as the rest.
    unchanged = (size <= 1) & (doubled | (error <= TARGET))
    same = jnp.ones_like(error), jnp.full_like(error, 0.5)
    factor, shrink = jax.lax.cond(unchanged, lambda: same, shorten)
    return Plan(new, jnp.where(doubled, 2.0, factor), shrink), rising


def _ratio(error: Float[Array, ""], order: Int[Array, ""]) -> Float[Array, ""]:
    """Computes the ratio of the length of a step that meets the target to the length of one with ``error``."""
    safe = jnp.where((error > 0) & jnp.isfinite(error), error, 1.0)
    return (TARGET / safe) ** (1.0 / (order + 1).astype(error.dtype))


HIGHEST_ADAMS = 12
# A step shorter than this, relative to the one before, adds no point.
SHORT_ADAMS_STEP = 0.01
# Another correction may change a state by this many tolerances. For smooth fields it changes less, because a correction
# is some 10 to 25 errors, and each next one is much smaller.
SETTLED = 30.0
# The orders whose errors are compared, relative to that of a step.
RANGE = range(-2, 2)


class PredictorCorrector(eqx.Module):
    """The single correction of a prediction, in place of the root finder of diffrax's implicit solvers.

    diffrax puts the tolerances of the step-size controller here, by which the order is chosen.
    """

    rtol: Any = FROM_CONTROLLER
    atol: Any = FROM_CONTROLLER
    norm: Any = FROM_CONTROLLER
    max_steps: ClassVar[int] = 1


class AdamsState(NamedTuple):
    """The state passed from the steps so far to the next.

    - ``differences``: the modified divided differences of the slopes at the last points, from order 0, ``folded``.
    - ``past``: the times from each of these points to the start of the next step.
    - ``order``: of the next step; 0 where nothing is known yet.
    - ``equal``: how many of the last steps had the same length.
    - ``rising``: whether the run is still starting.
    """

    differences: Float[Array, "lanes columns rows"]
    past: Float[Array, " rows"]
    order: Int[Array, ""]
    equal: Int[Array, ""]
    rising: Bool[Array, ""]


class Adams(AbstractMultistep):
    """The Adams–Bashforth–Moulton methods of orders 1 to 12, with variable order and step.

    The integral of the polynomial through the slopes at the last k points predicts the state at the end of the step.
    The slope there gives a polynomial of one order more, whose integral is the new state (local extrapolation), where
    the slope is evaluated again: two evaluations per step, whatever the order. For smooth problems at tight tolerances
    whose field costs more than a few additions of states.

    The order is chosen together with the step, so the step-size controller must be :class:`AdamsController`, which
    ``jaxball.simulate`` chooses automatically. The first step, and the first one after a jump, has order 1.

    **Arguments:**

    - ``max_order``: the largest number k of points, from 1 to 12.

    Source: Shampine & Gordon, *Computer Solution of Ordinary Differential Equations* (1975), whose code is DE/STEP;
    Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I* (1993), section III.5.

    **Raises:** ``ValueError`` for another ``max_order``; in a solve, ``TypeError`` for another step-size controller
    and for a term with a mass matrix.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> from jaxball import paper, simulate
    >>> from jaxball.simulation.solvers import Adams
    >>> run = simulate(paper.ball(), [0.0, 20.0], solver=Adams())
    >>> print(run.state.z[-1].round(6))
    [-3.992344 -3.866665]
    """

    approach: ClassVar[float] = 0.1  # see `approach_of`; stable in short steps only
    interpolation_cls: ClassVar = AdamsPolynomial
    controller_cls: ClassVar = AdamsController

    max_order: int = eqx.field(static=True)
    root_finder: Any  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, max_order: int = HIGHEST_ADAMS):
        self.max_order = check_order(max_order, HIGHEST_ADAMS)
        self.root_finder = PredictorCorrector()  # pyright: ignore[reportIncompatibleVariableOverride]

    def order(self, terms) -> int:
        """Returns the order of the result at the largest number of points, which local extrapolation raises by one."""
        return self.max_order + 1

    def init(self, terms, t0: Any, t1: Any, y0, args) -> AdamsState:
        x0, _ = ravel_pytree(y0)
        return AdamsState(
            differences=fold(jnp.zeros((self.max_order + 1, x0.size), x0.dtype)),
            past=jnp.zeros(self.max_order + 1, jnp.result_type(t0)),
            order=jnp.asarray(0),
            equal=jnp.asarray(0),
            rising=jnp.asarray(True),
        )

    def step(self, terms, t0: Any, t1: Any, y0, args, solver_state, made_jump: Any):
        self.require_controller()
        problem = flat_problem(terms, t0, t1, y0, args)
        problem.refuse_mass(self)
        first = (solver_state.order == 0) | made_jump
        # A row of a batch that has ended takes steps of length 0, which only must have finite derivatives.
        length = jnp.where(t1 == t0, jnp.ones_like(t1 - t0), t1 - t0)
        state = _begin(solver_state, first, length)
        points = Points(state.past, length)
        attempt = _attempt(problem, (t0, t1), state, points, first)
        size, sizes = self._errors(problem, state, points, attempt)
        # What is not finite in one difference is not finite in the last.
        finite = jnp.all(jnp.isfinite(attempt.x1)) & jnp.all(jnp.isfinite(attempt.differences[..., -1]))
        size = jnp.where(finite, size, jnp.where(at_limit(t0, t1), 0.0, jnp.inf))
        result = RESULTS.where(finite, RESULTS.successful, RESULTS.nonfinite)
        after, following = _after(state, points, attempt, first, (size, sizes))
        terms = jax.vmap(problem.unravel)(unfold(attempt.terms, problem.x0.size))
        dense = {"y0": y0, "terms": terms, "past": state.past}
        return problem.unravel(attempt.x1), self.plan_error(size, following), dense, after, result

    def _errors(
        self, problem: FlatProblem, state: AdamsState, points: Points, attempt: "Attempt"
    ) -> tuple[Float[Array, ""], Float[Array, "4"]]:
        """Estimates the error of the step, and the errors of four orders had all steps been as long, in units of the
        tolerance.
        """
        points = jax.lax.stop_gradient(points)
        sizes = self.sizes(problem, attempt.x1, unfold(attempt.corrections, problem.x0.size))
        sizes, again = sizes[:-1], sizes[-1]
        g, evenness = (a.astype(sizes.dtype) for a in (points.integrals(), points.evenness()))
        _, below, here, _ = _around(state.order, g)
        # Where a field jumps near the end of a step much shorter than those before, formulas of two orders agree.
        size = jnp.maximum(jnp.abs(here - below) * sizes[2], again / SETTLED)
        constants = jnp.asarray(adams_error_constants(g.size), sizes.dtype) * evenness
        return size, jnp.stack(_around(state.order, constants)) * sizes


class Attempt(NamedTuple):
    """A step that may be accepted.

    - ``x1``: the state at its end.
    - ``terms``: the terms of its polynomial, as multiples of which x grows, ``folded``.
    - ``corrections``: h times the modified divided differences with the slope at the predicted state, of the two orders
      below that of the step, its own, and the one above; and by how much another correction would change x₁, 0 in a
      first step. ``folded``.
    - ``differences``: the modified divided differences with the last slope, ``folded``.
    """

    x1: Float[Array, " n"]
    terms: Float[Array, "lanes columns rows"]
    corrections: Float[Array, "lanes columns 5"]
    differences: Float[Array, "lanes columns rows"]


def _begin(state: AdamsState, first: Bool[Array, ""], h: Float[Array, ""]) -> AdamsState:
    """Begins with the state, or on the first step with an empty one, whose points are arbitrary."""
    rows = state.past.size
    fresh = AdamsState(
        differences=jnp.zeros_like(state.differences),
        past=jnp.arange(rows, dtype=h.dtype) * h,
        order=jnp.ones_like(state.order),
        equal=jnp.zeros_like(state.equal),
        rising=jnp.ones_like(state.rising),
    )
    return select_tree(first, fresh, state)


def _attempt(
    problem: FlatProblem,
    times: tuple[Float[Array, ""], Float[Array, ""]],
    state: AdamsState,
    points: Points,
    first: Bool[Array, ""],
) -> Attempt:
    """Attempts a step: predicted, evaluated, corrected and evaluated again.

    In a first step the slope at its start replaces the last evaluation, and the one before is the last.
    """
    x0, k = problem.x0, state.order
    h, g, factors = (a.astype(x0.dtype) for a in (problem.control, points.integrals(), points.factors()))
    rows = jnp.arange(g.size)
    # With the factors β these are the differences at the end of the step if the slope there is the extrapolated one.
    starred = factors[None, None] * state.differences
    totals = sums(starred)
    extrapolations = _around(k, totals)
    predicted = x0 + h * _flat(jnp.sum(jnp.where(rows < k, g, 0.0)[None, None] * starred, axis=-1), x0)
    extrapolated, correction = _flat(extrapolations[2], x0), h * _around(k, g)[2]

    def evaluate(point, _):
        slope = problem.field(*point)
        x = jnp.where(first, x0 + h * slope, predicted + correction * (slope - extrapolated))
        # Both evaluations are turns of one loop, so that a field is compiled once.
        return (times[1], x), (x, slope)

    start = jnp.where(first, times[0], times[1]), jnp.where(first, x0, predicted)
    _, (states, (earlier_slope, last)) = jax.lax.scan(evaluate, start, length=2)
    change = correction * (last - earlier_slope)
    x1 = states[0] + jnp.where(first, change, 0.0)
    again = jnp.where(first, 0.0, change)
    # In a first step all differences are zero, except the slope at the start, which is known only now.
    columns = jnp.stack([jnp.where(first, earlier_slope, 0.0), jnp.where(first, last, earlier_slope), last, again])
    begun, slope, last, again = jnp.moveaxis(fold(columns), -1, 0)
    totals = totals + jnp.where((rows > 0)[None, None], begun[..., None], 0.0)
    corrections = [
        h * (slope - jnp.where(k + i > 0, begun, 0.0) - before) for i, before in zip(RANGE, extrapolations, strict=True)
    ]
    inside = h * (starred + jnp.where((rows == 0)[None, None], begun[..., None], 0.0))
    top_term = jnp.where((rows == k)[None, None], corrections[2][..., None], 0.0)
    terms = jnp.where((rows < k)[None, None], inside, top_term)
    return Attempt(x1, terms, jnp.stack([*corrections, again], axis=-1), last[..., None] - totals)


def _flat(fold: Float[Array, "lanes columns"], like: Float[Array, " n"]) -> Float[Array, " n"]:
    return unfold(fold[..., None], like.size)[0]


def _around(order: Int[Array, ""], rows: Float[Array, "*n rows"]) -> list[Float[Array, "*n"]]:
    """Returns the rows of the two orders below ``order``, of itself, and of the next one; zero where there is none."""
    count, others = rows.shape[-1], rows.ndim - 1
    chosen = (jnp.arange(count) == order).astype(rows.dtype).reshape(*(1,) * others, count)
    padded = jnp.pad(rows, [(0, 0)] * others + [(-RANGE[0], RANGE[-1])])
    return [jnp.sum(chosen * padded[..., i : i + count], axis=-1) for i in range(len(RANGE))]


def _after(
    state: AdamsState,
    points: Points,
    attempt: Attempt,
    first: Bool[Array, ""],
    errors: tuple[Float[Array, ""], Float[Array, "4"]],
) -> tuple[AdamsState, Plan]:
    """Returns the state after an attempt with these ``errors`` if it is accepted, and the plan for the next in any
    case.
    """
    h, spacing = points.h, state.past[1] - state.past[0]
    equal = jnp.where(jnp.abs(h - spacing) <= EQUAL * h, state.equal + 1, 1)
    # The starting phase ends with the first step that was not twice as long as the one before, because that failed or
    # was cut.
    rising = state.rising & (first | (h > 1.9 * spacing))
    following, rising = plan(*errors, state.order, equal, rising, state.past.size - 1)
    moved = AdamsState(attempt.differences, points.advance(), following.order, equal, rising)
    # Differences of two points so close to each other would be rounding errors only, so the end is not added.
    stayed = state._replace(past=state.past + h)
    # Only once: after that ``past[0]`` is not 0, and the next end is added, however short its step.
    tiny = ~first & (h < SHORT_ADAMS_STEP * spacing) & (state.past[0] == 0)
    return select_tree(tiny, stayed, moved), following
