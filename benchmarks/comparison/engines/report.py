"""Tables of the rows and work–precision diagrams: the error of each engine over its time, and its convergence."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxball.interface.output import replacing
from jaxball.plot import palette, style

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
SIZE = (7.2, 4.4)
# Okabe and Ito's colours (2008), which colour-blind readers can distinguish.
COLOURS = {
    "jaxball": "#D55E00",
    "MuJoCo": "#0072B2",
    "Drake": "#009E73",
    "PyBullet": "#CC79A7",
    "GRADSOLVE": "#E69F00",
}
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "h")


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


def draw(case: Case, rows: Sequence["Row"], folder: Path) -> Path:
    """Writes the diagram of one case as PNG to ``folder``, and returns its path."""
    path = folder / f"engines-{case.name}.png"
    with replacing(path) as beside:
        diagram(case, rows).savefig(beside, dpi=160)
    return path


def diagram(case: Case, rows: Sequence["Row"]) -> Figure:
    """The diagram of one case: a line for each setting of each engine."""
    ax = style.plane_axes(None, SIZE)
    for engine in dict.fromkeys(row.engine for row in rows):
        settings = dict.fromkeys(row.setting for row in rows if row.engine == engine)
        for place, setting in enumerate(settings):
            _curve(ax, engine, setting, MARKERS[place % len(MARKERS)], rows)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.grid(True, color=palette.FAINT, linewidth=0.4)
    ax.set_axisbelow(True)
    style.label_axes(ax, "processor time for a unit of simulated time [s]", "largest error of the path [radii]")
    ax.set_title(f"{case.title[0].upper()}{case.title[1:]}", fontproperties=style.LABEL, loc="left")
    ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, prop=style.SMALL_FONT)
    figure = ax.figure
    assert isinstance(figure, Figure)
    return figure


def _curve(ax: Axes, engine: str, setting: str, marker: str, rows: Sequence["Row"]) -> None:
    own = [row for row in rows if (row.engine, row.setting) == (engine, setting) and row.path and row.time]
    if own:
        width = 1.9 if engine == "jaxball" else 0.9
        times, paths = [row.time or 0.0 for row in own], [row.path or 0.0 for row in own]
        ax.plot(
            times,
            paths,
            label=f"{engine}, {setting}",
            color=COLOURS.get(engine, "0.4"),
            linewidth=width,
            marker=marker,
            markersize=3.5,
        )
