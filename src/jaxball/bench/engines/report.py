"""Tables of the rows: the smallest error of each engine within a time, and its convergence."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..measure import power, seconds
from .contract import Case

if TYPE_CHECKING:
    from .run import Row

BUDGETS = (1e-3, 1e-2, 1e-1)
COLUMNS = ("engine", *(f"{seconds(budget)} or less" for budget in BUDGETS))
ABOUT = (
    "The largest error of the path, in radii, of the best setting of each engine whose steps take no more processor "
    "time than this for a unit of simulated time. Below, every setting: errors at the smallest time step, of the speed "
    "of slip in √(g r) and of the energy in M g r, and the order at which the error of the path decreases with the "
    "step, between the smallest step and ten times it."
)


def markdown(cases: Sequence[Case], rows: Sequence["Row"]) -> str:
    """The tables of all cases that have rows."""
    parts = ["# Robots in general engines", ABOUT]
    for case in cases:
        own = [row for row in rows if row.case == case.name]
        if own:
            parts += [f"## {case.title[0].upper()}{case.title[1:]}", within(own), every(own)]
    return "\n\n".join(parts) + "\n"


def within(rows: Sequence["Row"]) -> str:
    """The table of the best settings of each engine within each time."""
    lines = [_line(COLUMNS), _rule(len(BUDGETS))]
    for engine in dict.fromkeys(row.engine for row in rows):
        cells = [_best([row for row in rows if row.engine == engine], budget) for budget in BUDGETS]
        lines.append(_line([engine, *cells]))
    return "\n".join(lines)


def _best(rows: Sequence["Row"], budget: float) -> str:
    good = [row for row in rows if row.path is not None and row.time is not None and row.time <= budget]
    if not good:
        return "–"
    best = min(good, key=lambda row: row.path or 0.0)
    return f"{power(best.path or 0.0, 2)} ({best.setting}, {best.step:g})"


def every(rows: Sequence["Row"]) -> str:
    """The table of all settings at their smallest step."""
    head = ("engine, setting", "step", "path", "order", "slip", "energy", "time")
    lines = [_line(head), _rule(len(head) - 1)]
    for engine, setting in dict.fromkeys((row.engine, row.setting) for row in rows):
        own = [row for row in rows if (row.engine, row.setting) == (engine, setting)]
        last = own[-1]
        name = f"{engine}, {setting}"
        if last.path is None or last.slip is None or last.energy is None or last.time is None:
            lines.append(_line([name, f"{last.step:g}", last.failure, "", "", "", ""]))
            continue
        measured = [power(last.path, 2), order(own), power(last.slip, 2), power(last.energy, 2), seconds(last.time)]
        lines.append(_line([name, f"{last.step:g}", *measured]))
    return "\n".join(lines)


def order(rows: Sequence["Row"]) -> str:
    """The order of convergence between the smallest step and ten times it, a dash where there are none."""
    last = rows[-1]
    before = [row for row in rows if abs(row.step / last.step - 10) < 1e-6]
    if not before or not before[0].path or not last.path:
        return "–"
    return f"{np.log10(before[0].path / last.path):.1f}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _rule(right: int) -> str:
    return "|:--|" + "--:|" * right
