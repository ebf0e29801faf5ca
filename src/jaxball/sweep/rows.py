"""The scenarios of many rows of a study, from reading its document once for all of them."""

import functools
import tomllib
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
import tomli_w
from jaxtyping import Array, Bool, Float, Int

from ..numerics.arrays import is_traced
from ..numerics.batches import in_batches
from ..physics.body import AbstractBody
from ..scenario import Scenario, ScenarioError
from ..scenario.errors import UntraceableError
from ..scenario.files import Parts, Structure, read_contents
from .batch import Batch
from .errors import StudyError
from .study import Study

BLOCK = 1024


def read_rows(
    study: Study, template: Scenario, rows: Int[np.ndarray, " rows"], values: Float[np.ndarray, "rows numbers"]
) -> tuple[Int[np.ndarray, " possible"], Batch | None]:
    """The indices of the possible ones among ``rows``, and their scenarios; None if there are none.

    Numbers in the document have the bits of ``values``; what is computed from them, such as a versor from an axis and
    an angle, agrees with the row's own document to rounding, and so does whether a row is possible.

    **Raises:** :class:`~jaxball.sweep.StudyError` for a row whose number of save times differs from the scenario's,
    where that number matters.
    """
    try:
        together = _read_together(study, values)
    except UntraceableError:
        together = _read_one_by_one(study, values)
    possible = np.flatnonzero(together.possible)
    if not possible.size:
        return possible, None
    driven = isinstance(template.system, AbstractBody) and template.system.coordinates
    ends_only = study.save == "end" and not template.step_to_times and not driven
    parts = together.parts
    for k in () if ends_only else possible[parts.times.count[possible] != template.times.size]:
        raise StudyError(
            f"Row {rows[k]} must have as many save times as the scenario, {template.times.size}, but it has "
            f"{int(parts.times.count[k])}; give `time.saves` instead of `time.step`."
        )
    # The times between do not affect the steps, and with `ends_only` they are not used.
    times = _times(together, template, ends_only)
    batch = Batch(template, parts.system, times, parts.state, parts.rtol, parts.atol, parts.contact, together.in_axes)
    return possible, batch if possible.size == len(rows) else batch.take(possible)


class _Together(NamedTuple):
    """Rows read together.

    - ``parts``: the parts that depend on their numbers, stacked.
    - ``in_axes``: which arrays of system and state differ, as of a :class:`Batch`.
    - ``times_differ``: whether their times differ.
    - ``possible``: which of the rows are possible.
    """

    parts: Parts
    in_axes: Any
    times_differ: bool
    possible: Bool[np.ndarray, " rows"]


def _read_together(study: Study, values: Float[np.ndarray, "rows numbers"]) -> _Together:
    structure, program = _compiled(tomli_w.dumps(study.document), study.paths)
    changing, possible, certain = in_batches(program, values, min(BLOCK, study.chunk))
    for k in np.flatnonzero(possible & ~certain):
        possible[k] = _read(study, values[k]) is not None
    leaves, tree = jax.tree.flatten(structure.parts)
    stacked = [
        changing[k] if k in changing else np.broadcast_to(np.asarray(leaf, dtype=float), (len(values), *np.shape(leaf)))
        for k, leaf in enumerate(leaves)
    ]
    differs = tree.unflatten([k in changing for k in range(len(leaves))])
    in_axes = jax.tree.map(lambda changes: 0 if changes else None, (differs.system, differs.state))
    return _Together(tree.unflatten(stacked), in_axes, any(jax.tree.leaves(differs.times)), possible)


@functools.lru_cache(maxsize=8)
def _compiled(text: str, paths: tuple[str, ...]) -> tuple[Structure, Callable[[np.ndarray], Any]]:
    """The structure of a document, given as TOML, and the compiled reader of several rows.

    It finds which leaves of the parts change, by index, and for each row whether all conditions hold, and whether that
    is certain.
    """
    structure = Structure(tomllib.loads(text), paths)

    def read(values: Float[Array, " numbers"]) -> tuple[dict[int, Array], Bool[Array, ""], Bool[Array, ""]]:
        parts, conditions = structure.traced(values)
        changing = {k: leaf for k, leaf in enumerate(jax.tree.leaves(parts)) if is_traced(leaf)}
        return changing, conditions.all_hold(), conditions.all_certain()

    return structure, jax.jit(jax.vmap(read))


def _times(together: _Together, template: Scenario, ends_only: bool) -> Float[np.ndarray, "rows times"]:
    """The save times of every row, meaningless where it is impossible."""
    times = together.parts.times
    if not together.times_differ:
        kept = template.times[[0, -1]] if ends_only else template.times
        return np.broadcast_to(kept, (together.possible.size, kept.size))
    if ends_only:
        return np.stack([times.start, times.end], axis=1)
    with np.errstate(all="ignore"):
        return np.ascontiguousarray(times.array(template.times.size))


def _read_one_by_one(study: Study, values: Float[np.ndarray, "rows numbers"]) -> _Together:
    each = [_read(study, row) for row in values]
    possible = np.array([parts is not None for parts in each])
    instead = Parts.of(read_contents(study.document))
    stacked = jax.tree.map(
        lambda *leaves: np.stack([np.asarray(leaf, dtype=float) for leaf in leaves]),
        *(instead if parts is None else parts for parts in each),
    )
    return _Together(stacked, 0, True, possible)


def _read(study: Study, values: Float[np.ndarray, " numbers"]) -> Parts | None:
    try:
        return Parts.of(read_contents(study.document_with(values)))
    except ScenarioError:
        return None
