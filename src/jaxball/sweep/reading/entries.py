"""The entries of a scenario's arrays, and which of them a number of its document is."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ...scenario import Scenario, ScenarioError, read_document
from ..numbers import value_at, with_numbers

# Numbers are moved by so little that hardly any condition is broken, and each by its own share. Where a number is at
# its limit, moves to one side are enough.
_MOVES = (2.0**-36, -(2.0**-35), 2.0**-34, -(2.0**-33))
_ENOUGH = 2


class Place(NamedTuple):
    """Where a number stands: which number, which array, and which of the array's entries, in its ravelled order."""

    column: int
    leaf: int
    entry: int


def parts_of(scenario: Scenario) -> tuple[Any, ...]:
    """What a row has of its own but for times: system, state, rtol and atol."""
    return scenario.system, scenario.state, scenario.rtol, scenario.atol


def arrays_of(scenario: Scenario) -> list[np.ndarray]:
    """The arrays of a scenario but for its times, in the order of ``jax.tree.leaves``."""
    return [np.asarray(leaf, dtype=float) for leaf in jax.tree.leaves(parts_of(scenario))]


def find_places(
    document: Mapping[str, Any], paths: tuple[str, ...], fixed: frozenset[int], derived: frozenset[int]
) -> frozenset[Place] | None:
    """Every place at which one of the numbers at ``paths`` stands as it is; None where that cannot be told.

    The numbers are moved all at once, each to a value of its own, and the document read. Each entry that changes must
    then be one of the values, bit for bit, but for those of the arrays ``derived``, of which nothing is found; each
    number must stand somewhere, but for those ``fixed``, which are not moved.
    """
    base = np.array([float(value_at(document, path)) for path in paths])
    before = arrays_of(read_document(dict(document)))
    shares = np.random.default_rng(0).permutation(len(paths)) / max(len(paths), 1)
    found, readings = None, 0
    for move in _MOVES:
        step = move * (1 + shares) * np.where(base == 0, 1.0, np.abs(base))
        step[list(fixed)] = 0.0
        values = base + step
        try:
            moved = read_document(with_numbers(document, dict(zip(paths, values.tolist(), strict=True))))
        except ScenarioError:
            continue
        places = _compared(before, arrays_of(moved), values, fixed, derived)
        if places is None or found not in (None, places):
            return None
        found, readings = places, readings + 1
    if readings < _ENOUGH:
        return None
    standing = {place.column for place in found or ()} | fixed
    return found if standing == set(range(len(paths))) else None


def _compared(
    before: list[np.ndarray],
    after: list[np.ndarray],
    values: Float[np.ndarray, " numbers"],
    fixed: frozenset[int],
    derived: frozenset[int],
) -> frozenset[Place] | None:
    columns = {value: column for column, value in enumerate(values.tolist()) if column not in fixed}
    found = set()
    for leaf, (old, new) in enumerate(zip(before, after, strict=True)):
        if old.shape != new.shape:
            return None
        for entry in np.flatnonzero(old.ravel() != new.ravel()) if leaf not in derived else ():
            column = columns.get(float(new.ravel()[entry]))
            if column is None:
                return None
            found.add(Place(column, leaf, int(entry)))
    return frozenset(found)
