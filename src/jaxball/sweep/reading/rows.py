"""The scenarios of many rows of a study."""

import jax
import numpy as np
import tomli_w
from jaxtyping import Float, Int

from ...scenario import Scenario, ScenarioError
from ..batch import Batch
from ..errors import StudyError
from ..study import Study
from .entries import arrays_of, parts_of
from .plan import plan_of
from .together import Together, read_together
from .verdict import BAD, GOOD, UNSURE

# How many rows of a study are read twice, and one in how many of a large one.
SOME, SELDOM = 8, 16384
_MIX = np.uint64(0x9E3779B97F4A7C15)  # 2⁶⁴ over the golden ratio, which scatters multiples of it


def read_rows(
    study: Study, template: Scenario, rows: Int[np.ndarray, " rows"], values: Float[np.ndarray, "rows numbers"]
) -> tuple[Int[np.ndarray, " possible"], Batch | None]:
    """The places in ``rows`` of those that a body can have, and their scenarios, None where there are none.

    **Raises:** :class:`~jaxball.sweep.StudyError` for a row with another number of save times than the scenario where
    that number matters.
    """
    ends_only = study.save == "end" and not template.step_to_times and not getattr(template.system, "driven", ())
    plan = plan_of(tomli_w.dumps(study.document), study.paths)
    if plan is not None:
        together = read_together(plan, study.paths, values, ends_only)
        found = _decided(study, template, rows, values, together, ends_only)
        if found is not None:
            return found
    return _one_by_one(study, template, rows, values, ends_only)


def _decided(
    study: Study, template: Scenario, rows: np.ndarray, values: np.ndarray, together: Together, ends_only: bool
) -> tuple[np.ndarray, Batch | None] | None:
    """The rows read together, those in doubt read again; None where such a row is other than it was read."""
    batch, verdict = together.batch, together.verdict.copy()
    times = batch.times
    again = (verdict == UNSURE) | _sampled(rows, study.rows)
    for k in np.flatnonzero(again):
        scenario = _read(study, values[k])
        if scenario is None:
            if verdict[k] == GOOD:
                return None
            verdict[k] = BAD
            continue
        if verdict[k] == BAD or not _same(batch, int(k), scenario) or together.counts[k] != scenario.times.size:
            return None
        kept = _kept(scenario, ends_only)
        if kept.size == times.shape[1] and times[k].tobytes() != kept.tobytes():
            if verdict[k] == GOOD:
                return None
            times = times.copy()
            times[k] = kept
        verdict[k] = GOOD
    possible = np.flatnonzero(verdict == GOOD)
    if not ends_only:
        for k in possible[together.counts[possible] != template.times.size]:
            raise _other_times(template, int(rows[k]), int(together.counts[k]))
    if not possible.size:
        return possible, None
    batch = batch._replace(template=template, times=times)
    return possible, batch if len(possible) == len(rows) else batch.take(possible)


def _one_by_one(
    study: Study, template: Scenario, rows: np.ndarray, values: np.ndarray, ends_only: bool
) -> tuple[np.ndarray, Batch | None]:
    possible, scenarios = [], []
    for k, row in enumerate(rows):
        scenario = _read(study, values[k])
        if scenario is None:
            continue
        if not ends_only and scenario.times.size != template.times.size:
            raise _other_times(template, int(row), scenario.times.size)
        possible.append(k)
        scenarios.append(scenario)
    if not scenarios:
        return np.array([], dtype=int), None
    stacked = [np.stack(leaves) for leaves in zip(*map(arrays_of, scenarios), strict=True)]
    system, state, rtol, atol = jax.tree.unflatten(jax.tree.structure(parts_of(scenarios[0])), stacked)
    times = np.stack([_kept(scenario, ends_only) for scenario in scenarios])
    return np.array(possible), Batch(template, system, times, state, rtol, atol)


def _read(study: Study, values: np.ndarray) -> Scenario | None:
    try:
        return study.scenario_with(values)
    except ScenarioError:
        return None


def _kept(scenario: Scenario, ends_only: bool) -> np.ndarray:
    """The save times: steps are as they would be without those between, and where ``ends_only`` nothing looks there."""
    return scenario.times[[0, -1]] if ends_only else scenario.times


def _same(batch: Batch, row: int, scenario: Scenario) -> bool:
    """Whether a row of a batch has the bits of a scenario."""
    read = [np.asarray(leaf[row]) for leaf in jax.tree.leaves((batch.system, batch.state, batch.rtol, batch.atol))]
    return all(a.tobytes() == b.tobytes() for a, b in zip(read, arrays_of(scenario), strict=True))


def _sampled(rows: np.ndarray, count: int) -> np.ndarray:
    """Which rows of a study of ``count`` are read twice: the first, the last, and others, by their numbers alone."""
    share = (rows.astype(np.uint64) * _MIX >> np.uint64(11)).astype(float) * 2.0**-53
    return (share < max(SOME / count, 1 / SELDOM)) | (rows == count - 1)


def _other_times(template: Scenario, row: int, count: int) -> StudyError:
    return StudyError(
        f"Row {row} must have as many save times as the scenario, {template.times.size}, but it has {count}; give "
        "`time.saves` instead of `time.step`."
    )
