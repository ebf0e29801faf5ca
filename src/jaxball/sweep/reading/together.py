"""Rows read together by a plan, with a verdict on each."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ...physics.body import AbstractBody, Disk
from ..batch import Batch
from .columns import Columns
from .conditions import conditions_hold
from .derived import angles, versors
from .entries import parts_of
from .inside import Shell, start_inside, stay_inside
from .parts import parts_fit
from .plan import Plan
from .times import Spans, save_times, spans
from .verdict import BAD, GOOD, Verdicts, verdicts, worst


class Together(NamedTuple):
    """Rows read together: their numbers, the verdict on each, and how many save times each has.

    Numbers are right wherever the verdict is not BAD, but for times where the counts differ.
    """

    batch: Batch
    verdict: Verdicts
    counts: np.ndarray


def read_together(
    plan: Plan, paths: tuple[str, ...], values: Float[np.ndarray, "rows numbers"], ends_only: bool
) -> Together:
    """Rows with ``values`` at ``paths``; of save times, the first and the last alone where ``ends_only``."""
    columns = Columns(plan.document, paths, values)
    kinds = np.full(columns.rows, True)
    for name, kind in plan.kinds.items():
        kinds &= kind.hold(columns.at(name))
    if not np.all(kinds):
        # Nothing is to be computed from numbers that cannot be.
        columns = Columns(plan.document, paths, np.where(kinds[:, None], values, plan.base(paths)))
    with np.errstate(all="ignore"):
        span = spans(columns)
        parts, found = _parts(plan, columns, span)
        verdict = worst(verdicts(kinds, ~kinds), span.verdict, found, _judged(plan, columns, span, parts))
    times = _times(plan, columns, span, verdict, ends_only)
    system, state, rtol, atol = parts
    in_axes = jax.tree.map(lambda changes: 0 if changes else None, plan.changes[:2])
    return Together(Batch(plan.template, system, times, state, rtol, atol, in_axes), verdict, span.counts)


def _parts(plan: Plan, columns: Columns, span: Spans) -> tuple[tuple, Verdicts]:
    """System, state and tolerances, stacked, and the verdicts on what was found from other numbers."""
    arrays = [np.broadcast_to(array, (columns.rows, *array.shape)) for array in plan.arrays]
    for leaf in {place.leaf for place in plan.places}:
        arrays[leaf] = arrays[leaf].copy()
    for column, leaf, entry in plan.places:
        arrays[leaf].reshape(columns.rows, -1)[:, entry] = columns.values[:, column]
    structure = jax.tree.structure(parts_of(plan.template))
    places = jax.tree.unflatten(structure, range(len(arrays)))[1]
    verdict = np.full(columns.rows, GOOD)
    if plan.versors:
        arrays[places.q], verdict = versors(columns, span.verdict == BAD)
    if plan.angles:
        system = jax.tree.unflatten(structure, arrays)[0]
        for name, array in angles(system, span.start, plan.angles).items():
            arrays[getattr(places, name)] = array
    if plan.multiplier:
        arrays[places.multiplier] = -arrays[places.y] * arrays[places.xdot]
    return jax.tree.unflatten(structure, arrays), verdict


def _judged(plan: Plan, columns: Columns, span: Spans, parts: tuple) -> Verdicts:
    system, state = parts[:2]
    changes, changed_state = plan.changes[:2]
    time = columns.change("time")
    found = [np.full(columns.rows, GOOD)]
    changed = jax.tree.leaves(changes)
    if not isinstance(system, AbstractBody):
        return worst(*found, conditions_hold(system, state, span.start), parts_fit(system, changes, columns.rows))
    if any(changed):
        found += [conditions_hold(system, state, span.start), parts_fit(system, changes, columns.rows)]
    shell = Shell(
        np.asarray(system.radius)[:, None],
        span.start[:, None],
        span.end[:, None],
        bool(changes.radius),
        time,
        isinstance(system, Disk),
    )
    if any(changed) or time:
        found.append(stay_inside(system, changes, shell))
    if system.driven and any([*changed, time, changed_state.theta]):
        found.append(start_inside(system, state.theta))
    return worst(*found)


def _times(plan: Plan, columns: Columns, span: Spans, verdict: Verdicts, ends_only: bool) -> np.ndarray:
    count = 2 if ends_only else plan.template.times.size
    kept = plan.template.times[[0, -1]] if ends_only else plan.template.times
    if not columns.change("time"):
        return np.broadcast_to(kept, (columns.rows, count))
    if ends_only:
        return np.stack([span.start, span.end], axis=1)
    times = np.full((columns.rows, count), np.nan)
    rows = np.flatnonzero((span.verdict == GOOD) & (verdict != BAD) & (span.counts == count))
    times[rows] = save_times(columns, span, rows, count)
    return times
