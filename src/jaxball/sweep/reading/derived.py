"""What a scenario's state has from other numbers than its own, in many rows: versors, angles at the start, multipliers.

Each is computed by the reader itself or in the same operations, so that it has the same bits.
"""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from ...classical import VakonomicState
from ...scenario import ScenarioError
from ...scenario.initial import read_orientation, starting_angles
from .columns import Columns
from .verdict import BAD, GOOD, Verdicts

ORIENTATION = ("versor", "axis", "angle")


def orientation_changes(columns: Columns) -> bool:
    """Whether the versor of the initial state changes from row to row."""
    return columns.change(*(f"initial.{name}" for name in ORIENTATION))


def angles_to_find(document: Mapping[str, Any], system: Any) -> list[str]:
    """Which of θ and θ̇ of driven masses are found from the schedules."""
    given = document.get("initial", {})
    return [name for name in ("theta", "thetadot") if getattr(system, "driven", ()) and name not in given]


def multiplier_is_found(document: Mapping[str, Any], state: Any) -> bool:
    """Whether the multiplier of a vakonomic particle is found from y and ẋ."""
    return isinstance(state, VakonomicState) and "multiplier" not in document.get("initial", {})


def versors(columns: Columns, skip: np.ndarray) -> tuple[np.ndarray, Verdicts]:
    """The versors of the initial states, but for the rows ``skip``, and the verdicts on them."""
    table = columns.document["initial"]
    choice = "axis" if "axis" in table else "versor"
    given = {name: columns.at(f"initial.{name}") for name in ORIENTATION if name in table}
    found, verdict = np.full((columns.rows, 4), np.nan), np.full(columns.rows, GOOD)
    for row in np.flatnonzero(~skip):
        try:
            found[row] = read_orientation(choice, {name: x[row] for name, x in given.items()}, "initial")["q"]
        except ScenarioError:
            verdict[row] = BAD
    return found, verdict


def angles(system: Any, start: np.ndarray, names: list[str]) -> dict[str, np.ndarray]:
    """θ and θ̇ of the driven masses at the start, as far as they are in ``names``."""
    law = system.law
    schedules = law.targets if hasattr(law, "targets") else law.schedules
    found = {name: np.empty((len(start), len(schedules))) for name in names}
    for row, t in enumerate(start):
        of_row = starting_angles(jax.tree.map(lambda leaf, row=row: leaf[row], schedules), t)
        for name, array in found.items():
            array[row] = of_row[name]
    return found
