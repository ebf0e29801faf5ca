"""Reads the scenarios of many rows of a study at once, stacked, from one reading of its document."""

import functools
import tomllib
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
import tomli_w
from jaxtyping import Array, Bool, Float, Int

from ... import programs
from ...files.scenario.errors import ScenarioError, UntraceableError
from ...files.scenario.files import read_contents
from ...files.scenario.scenario import Scenario
from ...files.scenario.traced import Parts, trace
from ...interface.compat import is_traced
from ...physics.body import AbstractBody
from ...programs.batches import in_batches
from .files import StudyError
from .study import Study


class Batch(NamedTuple):
    """Scenarios that differ only in numbers, stacked along the leading axis of each array. All arrays are NumPy's.

    - ``template``: what all have in common: its ``solver``, ``max_steps``, ``step_to_times``, ``dae`` and ``project``
      apply to all of them; its numbers are not used.
    - ``system``, ``state``: as in a scenario, every leaf stacked.
    - ``times``: the save times, equally many for each scenario; only the first and the last where those between are not
      used.
    - ``rtol``, ``atol``: the tolerances.
    - ``contact``: the law of contact, every leaf stacked, or None.
    - ``in_axes``: 0 for the arrays of ``(system, state, events)`` that change from row to row, None for the others, as
      :func:`jaxball.simulation.ensemble.simulate_ensemble` takes it.
    - ``events``: those of the scenario by name, every leaf stacked.
    - ``sensors``: those of the scenario by name, every leaf stacked.
    - ``loop``: the numbers of its closed loop, every leaf stacked, or None without feedback.
    - ``loop_changes``: which leaves of ``loop`` change from row to row, in a PyTree of its structure.
    """

    template: Scenario
    system: Any
    times: Float[np.ndarray, "rows times"]
    state: Any
    rtol: Float[np.ndarray, " rows"]
    atol: Float[np.ndarray, " rows"]
    contact: Any
    in_axes: Any
    events: Any
    sensors: Any = None
    loop: Any = None
    loop_changes: Any = None

    @property
    def rows(self) -> int:
        """How many scenarios there are."""
        return len(self.times)

    def take(self, rows: Any) -> "Batch":
        """Returns some of the scenarios, by a slice or by indices."""
        # The template and the axes are common to all rows.
        names = ("system", "times", "state", "rtol", "atol", "contact", "events", "sensors", "loop")
        stacked = {name: getattr(self, name) for name in names}
        return self._replace(**jax.tree.map(lambda leaf: leaf[rows], stacked))

    def unstack_shared(self) -> tuple[Any, Any, Any]:
        """Returns system, state and events, with the arrays that do not change unstacked."""
        return jax.tree.map(
            lambda axis, part: jax.tree.map(lambda leaf: leaf[0], part) if axis is None else part,
            self.in_axes,
            (self.system, self.state, self.events),
            is_leaf=lambda axis: axis is None,
        )


class Request(NamedTuple):
    """What an engine must compute.

    - ``study``: which says what to find, and that no call has more scenarios than its ``chunk``.
    - ``threads``: how many cores it may use.
    """

    study: Study
    threads: int = 1


# From scenarios to arrays with the scenarios as leading axis: `status`, `steps`, `rejected`, `reached`, the entries of
# the state at each of a scenario's times, and the extremes of the contact force where requested.
# It must be a module-level function, so that it can be sent to a worker.
Engine = Callable[[Batch, Request], dict[str, np.ndarray]]


ROWS = 1024


def read_rows(
    study: Study, template: Scenario, rows: Int[np.ndarray, " rows"], values: Float[np.ndarray, "rows numbers"]
) -> tuple[Int[np.ndarray, " possible"], Batch | None]:
    """Returns the indices of the possible ones among ``rows``, and their scenarios; None if there are none.

    Numbers in the document have the bits of ``values``; what is computed from them, such as a versor from an axis and
    an angle, agrees with the row's own document to rounding, and so does whether a row is possible.

    **Raises:** :class:`~jaxball.studies.sweep.StudyError` for a row whose number of save times differs from the
    scenario's, where that number matters.
    """
    try:
        # One reading for all rows, with traced numbers, if the document can be read in this way.
        stacked = _read_stack(study, values)
    except UntraceableError:
        stacked = _read_one_by_one(study, values)
    possible = np.flatnonzero(stacked.possible)
    if not possible.size:
        return possible, None
    driven = isinstance(template.system, AbstractBody) and template.system.coordinates
    looked_at = study.readings or template.feedback is not None
    ends_only = study.save == "end" and not template.step_to_times and not driven and not looked_at
    parts = stacked.parts
    # Save times are an array of one shape for all rows, unless only their ends are used.
    for k in () if ends_only else possible[parts.times.count[possible] != template.times.size]:
        raise StudyError(
            f"Row {rows[k]} must have as many save times as the scenario, {template.times.size}, but it has "
            f"{int(parts.times.count[k])}; give `time.saves` instead of `time.step`."
        )
    # The times between do not affect the steps, and with `ends_only` they are not used.
    times = _times(stacked, template, ends_only)
    main = parts.system, times, parts.state, parts.rtol, parts.atol, parts.contact
    batch = Batch(template, *main, stacked.in_axes, parts.events, parts.sensors, parts.loop, stacked.loop_changes)
    return possible, batch if possible.size == len(rows) else batch.take(possible)


class _Stacked(NamedTuple):
    """Rows read at once, stacked.

    - ``parts``: the parts that depend on their numbers, stacked.
    - ``in_axes``: which arrays of system, state and events differ, as in a :class:`Batch`.
    - ``loop_changes``: as in a :class:`Batch`.
    - ``times_differ``: whether their times differ.
    - ``possible``: which of the rows are possible.
    """

    parts: Parts
    in_axes: Any
    loop_changes: Any
    times_differ: bool
    possible: Bool[np.ndarray, " rows"]


def _read_stack(study: Study, values: Float[np.ndarray, "rows numbers"]) -> _Stacked:
    parts, program = _compile_reader(tomli_w.dumps(study.document), study.paths)
    # Of one size, so that chunks of a study share one compiled program.
    changing, possible, certain = in_batches(program, values, min(ROWS, study.chunk))
    # Where a condition holds but for rounding, the row's own document decides, as it would for a single run.
    for k in np.flatnonzero(possible & ~certain):
        possible[k] = _read(study, values[k]) is not None
    leaves, tree = jax.tree.flatten(parts)
    stacked = [
        # Without memory of its own for each row.
        changing[k] if k in changing else np.broadcast_to(_as_array(leaf), (len(values), *np.shape(leaf)))
        for k, leaf in enumerate(leaves)
    ]
    differs = tree.unflatten([k in changing for k in range(len(leaves))])
    in_axes = jax.tree.map(lambda changes: 0 if changes else None, (differs.system, differs.state, differs.events))
    return _Stacked(tree.unflatten(stacked), in_axes, differs.loop, any(jax.tree.leaves(differs.times)), possible)


def _as_array(leaf: Any) -> np.ndarray:
    """Returns a leaf in float64, but leaves arrays of whole numbers unchanged."""
    is_whole = isinstance(leaf, jax.Array | np.ndarray) and leaf.dtype.kind in "iu"
    return np.asarray(leaf) if is_whole else np.asarray(leaf, dtype=float)


@functools.lru_cache(maxsize=8)
def _compile_reader(text: str, paths: tuple[str, ...]) -> tuple[Parts, Callable[[np.ndarray], Any]]:
    """Compiles the reader of several rows of a document, given as TOML, and returns it after the document's own parts.

    It finds which leaves of the parts change, by index, and for each row whether all conditions hold, and whether that
    is certain.
    """
    document = tomllib.loads(text)

    def read(values: Float[Array, " numbers"]) -> tuple[dict[int, Array], Bool[Array, ""], Bool[Array, ""]]:
        parts, conditions = trace(document, paths, values)
        # Only leaves that depend on the traced numbers are traced themselves.
        changing = {k: leaf for k, leaf in enumerate(jax.tree.leaves(parts)) if is_traced(leaf)}
        return changing, conditions.all_hold(), conditions.all_certain()

    return Parts.of(read_contents(document), document), programs.jit(jax.vmap(read))


def _times(stacked: _Stacked, template: Scenario, ends_only: bool) -> Float[np.ndarray, "rows times"]:
    """Returns the save times of every row, meaningless where it is impossible."""
    times = stacked.parts.times
    if not stacked.times_differ:
        common_times = template.times[[0, -1]] if ends_only else template.times
        return np.broadcast_to(common_times, (stacked.possible.size, common_times.size))
    if ends_only:
        return np.stack([times.start, times.end], axis=1)
    # Times of impossible rows may overflow; they are not used.
    with np.errstate(all="ignore"):
        return np.ascontiguousarray(times.array(template.times.size))


def _read_one_by_one(study: Study, values: Float[np.ndarray, "rows numbers"]) -> _Stacked:
    each = [_read(study, row) for row in values]
    possible = np.array([parts is not None for parts in each])
    # An impossible row takes any numbers that can be stacked; it is left out before the solve.
    instead = Parts.of(read_contents(study.document), study.document)
    stacked = jax.tree.map(
        lambda *leaves: np.stack([_as_array(leaf) for leaf in leaves]),
        *(instead if parts is None else parts for parts in each),
    )
    in_axes = 0, 0, dict.fromkeys(stacked.events, 0)
    return _Stacked(stacked, in_axes, jax.tree.map(lambda leaf: True, stacked.loop), True, possible)


def _read(study: Study, values: Float[np.ndarray, " numbers"]) -> Parts | None:
    try:
        document = study.document_with(values)
        return Parts.of(read_contents(document), document)
    except ScenarioError:
        return None
