"""How the rows of a study are read at once: found a single time in a process."""

import functools
import re
import tomllib
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np

from ...scenario import Scenario, read_document
from ...scenario.values import Numbers, kinds_of_numbers
from ..numbers import list_of, value_at
from .columns import Columns
from .derived import angles_to_find, multiplier_is_found, orientation_changes
from .entries import Place, arrays_of, find_places, parts_of

# Numbers that stand nowhere in a scenario as they are, and those on which the angles of driven masses depend.
_NOWHERE = re.compile(r"time\.|initial\.(versor|axis|angle)\b")
_OF_ANGLES = re.compile(r"time\.(start|at)\b|masses\[\d+\]\.schedule\.")

# Numbers that have no bearing on where a body is in balance.
_NOT_OF_BALANCE = re.compile(r"(initial\.(Omega|z|phidot)|body\.(inertia|gravity)|time\.(end|step)|solve\.\w+)\b")


class Plan(NamedTuple):
    """How rows are read at once.

    - ``document``, ``template``: the scenario of the study.
    - ``kinds``: the kind of each number, or list of numbers, that changes, by its path.
    - ``arrays``: the arrays of the template.
    - ``places``: where the numbers that change stand in them.
    - ``versors``, ``angles``, ``multiplier``: what else changes, and has to be found from other numbers.
    - ``changes``: which of the arrays change, as a tree of their structure.
    """

    document: Mapping[str, Any]
    template: Scenario
    kinds: Mapping[str, Numbers]
    arrays: list[np.ndarray]
    places: frozenset[Place]
    versors: bool
    angles: list[str]
    multiplier: bool
    changes: Any

    def base(self, paths: tuple[str, ...]) -> np.ndarray:
        """The template's own values at ``paths``."""
        return np.array([float(value_at(self.document, path)) for path in paths])


@functools.lru_cache(maxsize=8)
def plan_of(text: str, paths: tuple[str, ...]) -> Plan | None:
    """The plan for a scenario's document, given as TOML, with other numbers at ``paths``.

    None where rows must be read one by one: where the angles of ``balance`` may change, and where it cannot be told
    what becomes of a number.
    """
    document = tomllib.loads(text)
    with kinds_of_numbers() as kinds:
        template = read_document(document)
    names = {list_of(path)[0] for path in paths}
    balanced = "balance" in document.get("initial", {}) and not all(map(_NOT_OF_BALANCE.match, paths))
    if balanced or not names <= kinds.keys():
        return None
    columns = Columns(document, paths, np.empty((0, len(paths))))
    arrays = arrays_of(template)
    structure = jax.tree.structure(parts_of(template))
    _, state, *_ = jax.tree.unflatten(structure, range(len(arrays)))
    orientation = orientation_changes(columns)
    angles = angles_to_find(document, template.system) if any(map(_OF_ANGLES.match, paths)) else []
    multiplier = multiplier_is_found(document, template.state) and columns.change("initial")
    derived = ([state.q] if orientation else []) + [getattr(state, name) for name in angles]
    derived += [state.multiplier] if multiplier else []
    fixed = [k for k, path in enumerate(paths) if _NOWHERE.match(path)]
    places = find_places(document, paths, frozenset(fixed), frozenset(derived))
    if places is None:
        return None
    moved = {place.leaf for place in places} | set(derived)
    changes = jax.tree.unflatten(structure, [leaf in moved for leaf in range(len(arrays))])
    return Plan(
        document,
        template,
        {name: kinds[name] for name in names},
        arrays,
        places,
        orientation,
        angles,
        multiplier,
        changes,
    )
