"""Solves the rows of a study whose scenario has feedback, as closed loops in vector lanes; ``run`` calls it.

Where rows differ in what the feedback depends on, such as its weights or the model, each has a feedback of its own;
otherwise all share that of the first.
"""

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ... import programs
from ...control.feedback import AbstractFeedback
from ...control.loop import ClosedLoop, run_loop
from ...control.weights import weight_matrix
from ...files.scenario import RegulatorSettings
from ...files.scenario.closed_loop import LoopNumbers, build_sampled_system
from ...files.scenario.feedback import sample_of
from ...files.scenario.scenario import Scenario
from ...numerics.arrays import arrays_of
from ...programs.operation import in_threads
from ...simulation.ensemble import AbstractReduction
from ...simulation.ensemble.reductions import Observed
from ...simulation.quantities import values
from ...simulation.variables import Variable
from .outputs import history_results
from .rows import Batch, Request

LOOP = {
    "largest_deviation": Variable((), "", "largest weighted deviation from the motion, at the samples"),
    "final_deviation": Variable((), "", "weighted deviation from the motion at the end"),
    "returned": Variable((), "", "1 if the final deviation is within the tolerance of the study", dtype="i1"),
    "largest_input": Variable((), "", "largest magnitude of an input"),
    "saturated": Variable((), "1", "share of samples at which an input is at its limit"),
}
OF_ESTIMATOR = {
    "nis_per_reading": Variable((), "1", "mean normalised innovation squared by the number of readings"),
    "nees_per_direction": Variable((), "1", "mean normalised estimation error squared by the uncertain directions"),
    "largest_estimation_error": Variable((), "", "largest weighted error of the estimate, at the samples"),
}


class Sought(NamedTuple):
    """What to find of each row.

    - ``samples``: how many there are.
    - ``longest``: the longest delay of a row.
    - ``reductions``: by name, of the quantities at the samples.
    - ``readings``: whether to find what sensors read.
    """

    samples: int
    longest: int
    reductions: tuple[tuple[str, AbstractReduction], ...]
    readings: bool


class Common(NamedTuple):
    """What all rows have in common, as arrays.

    - ``sample``, ``t0``: the time between samples, and that of the first.
    - ``measure``: the weights of deviations, whose trace is 1.
    - ``within``: how small a deviation must be in the end.
    - ``feedback``: from the state, if it is common.
    """

    sample: Float[Array, ""]
    t0: Float[Array, ""]
    measure: Float[Array, "n n"]
    within: Float[Array, ""]
    feedback: AbstractFeedback | None


def loop_variables(template: Scenario) -> dict[str, Variable]:
    """Returns the variables of a closed loop in the store of a study."""
    return LOOP | (OF_ESTIMATOR if template.estimator is not None else {})


def solve_loops(batch: Batch, request: Request, reductions: Mapping[str, AbstractReduction]) -> dict[str, np.ndarray]:
    """Computes the results of rows, by the names of variables."""
    template, numbers, changes, readings = batch.template, batch.loop, batch.loop_changes, request.study.readings
    # What does not differ is not mapped over, so that a feedback from it is computed once.
    row_numbers, shared = eqx.partition(numbers, changes)
    shared = jax.tree.map(lambda leaf: leaf[0], shared)
    # The longest delay decides the size of the queue in all rows.
    sought = Sought(template.times.size - 1, int(np.max(numbers.delay)), tuple(reductions.items()), readings)
    common = _common(template, numbers, changes, request.study.within, sought.samples)
    with in_threads(request.threads):
        results = jax.vmap(functools.partial(_row, sought, common, shared))(
            (row_numbers, batch.sensors if readings else None)
        )
    return jax.tree.map(np.asarray, results)


def _common(template: Scenario, numbers: LoopNumbers, changes: Any, within: float, samples: int) -> Common:
    sampled = build_sampled_system(template)
    settings = template.feedback
    Q = settings.Q if isinstance(settings, RegulatorSettings) else 1.0
    weights = np.asarray(weight_matrix("Q", Q, sampled.directions))
    sample, t0 = jnp.asarray(sample_of(template.times)), jnp.asarray(float(template.times[0]))
    feedback = None
    # A feedback that all rows share is computed once, before them.
    if not any(jax.tree.leaves(changes.of_feedback)):
        feedback = _feedback(jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), numbers), sample, t0, samples)
    return Common(sample, t0, jnp.asarray(weights / np.trace(weights)), jnp.asarray(within), feedback)


@programs.filter_jit
def _feedback(numbers: LoopNumbers, sample: Array, t0: Array, samples: int) -> AbstractFeedback:
    return numbers.feedback(sample, t0, samples)


@programs.filter_jit
def _row(sought: Sought, common: Common, shared: Any, row: Any) -> dict[str, Array]:
    """Runs the closed loop of one row."""
    row_numbers, sensors = row
    numbers: LoopNumbers = eqx.combine(row_numbers, shared)
    controller = (
        numbers.feedback(common.sample, common.t0, sought.samples) if common.feedback is None else common.feedback
    )
    feedback, plant, first = numbers.around(controller)
    loop = run_loop(feedback, plant, first, sought.samples, numbers.delay, None, sought.longest)
    # A body whose modes are saved, or whose sensors are read, is simulated once more in one piece.
    run = loop.run if plant.contact is not None or sought.readings else None
    results = {
        "status": loop.status,
        "steps": jnp.asarray(sought.samples),
        "rejected": jnp.asarray(0),
        "reached": loop.reached,
        **arrays_of(loop.states),
        **_of_loop(loop, common),
        **_of_estimate(loop, common),
        **_reduce(loop, sought.reductions),
    }
    if run is not None:
        results |= history_results(run.history.of_body)
    if run is not None and sought.readings:
        results |= {f"measured_{name}": read for name, read in run.measured(sensors).items()}
    return results


def _of_loop(loop: ClosedLoop, common: Common) -> dict[str, Array]:
    along = _size(loop.xi, common)
    return {
        "largest_deviation": jnp.max(along),
        "final_deviation": along[-1],
        "returned": along[-1] < common.within,
        "largest_input": jnp.max(jnp.abs(loop.u)),
        "saturated": jnp.mean(jnp.any(loop.saturated, axis=1).astype(along.dtype)),
    }


def _of_estimate(loop: ClosedLoop, common: Common) -> dict[str, Array]:
    estimate = loop.feedback.estimates(loop.times, loop.memory)
    if estimate is None:
        return {}
    before = jax.tree.map(lambda leaf: leaf[:-1], loop.states)
    now = jax.tree.map(lambda leaf: leaf[:-1], estimate)
    mask, dtype = now.read > 0, loop.xi.dtype
    # Sums divided by sums, so that a sample counts in proportion to what was read or uncertain at it.
    return {
        "nis_per_reading": jnp.sum(jnp.where(mask, now.nis, 0.0)) / jnp.sum(now.read).astype(dtype),
        "nees_per_direction": jnp.sum(now.nees(before)) / jnp.sum(now.uncertain).astype(dtype),
        "largest_estimation_error": jnp.max(_size(now.errors(before), common)),
    }


def _size(xi: Float[Array, "T n"], common: Common) -> Float[Array, " T"]:
    """Computes the deviations √(ξ·Q ξ / tr Q)."""
    squared = jnp.sum((xi @ common.measure) * xi, axis=1)
    # Rounding may make a square of zero weights negative.
    return jnp.sqrt(jnp.maximum(squared, 0.0))


def _reduce(loop: ClosedLoop, reductions: tuple[tuple[str, AbstractReduction], ...]) -> dict[str, Array]:
    """Reduces the samples and the end, where the last input is still held, to what is reported."""
    if not reductions:
        return {}
    quantities = tuple(dict.fromkeys(item.quantity for _, item in reductions))
    # No input begins at the end.
    u = jnp.concatenate([loop.u, loop.u[-1:]])

    def quantities_at(sample: Any) -> Array:
        t, moving, u = sample
        return values(quantities, loop.plant.as_solved(loop.plant.hold(u)).prepare(), t, moving)

    every, reports = jax.lax.map(quantities_at, (loop.times, loop.moving, u)), {}
    for name, item in reductions:
        series = every[:, quantities.index(item.quantity)]
        places = [jnp.argmax(sign * series) for sign in item.signs]
        extremes, times = tuple(series[k] for k in places), tuple(loop.times[k] for k in places)
        area = jnp.sum(0.5 * (series[1:] + series[:-1]) * jnp.diff(loop.times))
        observed = Observed(series[0], extremes, times, area)
        reports |= {name + end: value for end, value in item.result(observed).items()}
    return reports
