"""Work–precision diagrams: the time of a solve over the error that it achieved."""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullLocator

from jaxball.interface.output import replacing
from jaxball.plot import palette, style

from .contenders import ALL
from .measure import Row
from .problem import Problem

SIZE = (7.2, 4.8)
SMALLEST_ERROR = 1e-17  # where an error of exactly zero is drawn
GAP = 0.043  # between two labels, as a fraction of the height
LABELS_AT = 1.05
LEADER = {"arrowstyle": "-", "linewidth": 0.4, "linestyle": ":", "shrinkA": 2, "shrinkB": 3, "relpos": (0.0, 0.5)}
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "h", "*")


class Pen(NamedTuple):
    """The style of a family's lines: jaxball's are bold, diffrax's dashed, all others thin."""

    width: float
    dashes: Any
    size: float


BOLD, DASHED, THIN = Pen(1.9, "-", 4.5), Pen(1.2, (0, (5, 2)), 3.5), Pen(0.8, "-", 3.0)
PENS = {"jaxball": BOLD, "diffrax": DASHED}
# Okabe and Ito's colours (2008), which colour-blind readers can distinguish, with black and a grey.
COLOURS = {"diffrax": "#CC79A7", "SciPy": "0.5", "numbalsoda": "#56B4E9", "heyoka": "#E69F00", "CasADi": "black"}
OWN_COLOURS = {"Gauss": "#D55E00", "RadauIIA": "#0072B2"}
OTHER_OWN_COLOUR = "#009E73"


def draw(problem: Problem, rows: Sequence[Row], folder: Path) -> list[Path]:
    """Writes the diagram as PNG and PDF to ``folder``, and returns the paths; none if no row has an error."""
    if not any(row.error is not None for row in rows):
        return []
    figure = diagram(problem, rows)
    paths = [folder / f"{problem.name}.{suffix}" for suffix in ("png", "pdf")]
    for path in paths:
        with replacing(path) as beside:
            figure.savefig(beside, dpi=200)
    return paths


def diagram(problem: Problem, rows: Sequence[Row]) -> Figure:
    """The diagram of one problem: a line for each solver, more accurate to the right, labelled at the margin."""
    ax = style.plane_axes(None, SIZE)
    for solver in dict.fromkeys(row.solver for row in rows):
        _line(ax, solver, [row for row in rows if row.solver == solver and row.error is not None])
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.invert_xaxis()
    for axis in (ax.xaxis, ax.yaxis):
        _number_axis(axis)
    ax.grid(True, color=palette.FAINT, linewidth=0.4)
    ax.set_axisbelow(True)
    kind = "largest relative error" if problem.relative else "largest error"
    style.label_axes(ax, f"{kind} at $t = {style.number(problem.end)}$", "time of a solve [s]")
    ax.set_title(_with_subscripts(problem.title), fontproperties=style.LABEL, loc="left")
    _name_lines(ax)
    figure = ax.figure
    assert isinstance(figure, Figure)
    return figure


def line_style(solver: str) -> dict[str, Any]:
    """Colour, dashes, width and marker of a solver, the same in every figure."""
    family = ALL[solver].family.name
    pen = PENS.get(family, THIN)
    colour = COLOURS.get(family) or OWN_COLOURS.get(solver.split()[0], OTHER_OWN_COLOUR)
    siblings = [name for name, contender in ALL.items() if contender.family.name == family]
    return {
        "color": colour,
        "linewidth": pen.width,
        "linestyle": pen.dashes,
        "marker": MARKERS[siblings.index(solver) % len(MARKERS)],
        "markersize": pen.size,
        "zorder": 3 if family == "jaxball" else 2,
    }


def _number_axis(axis: Axis) -> None:
    """A number at each power of ten, and at twice and five times it where there are few powers."""
    low, high = sorted(axis.get_view_interval())
    few = high < 100 * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=20))
    axis.set_major_formatter(LogFormatterSciNotation(minor_thresholds=(math.inf, math.inf)))
    axis.set_minor_locator(NullLocator())


def _line(ax: Axes, solver: str, rows: Sequence[Row]) -> None:
    if rows:
        errors = [max(row.error or 0.0, SMALLEST_ERROR) for row in rows]
        ax.plot(errors, [row.time or 0.0 for row in rows], label=solver, **line_style(solver))


def _name_lines(ax: Axes) -> None:
    """Each line's name at the right margin, connected with its most accurate point."""
    ends = {}
    for line in ax.lines:
        points = np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float)
        ends[str(line.get_label())] = points[np.argmin(points[:, 0])]
    ax.autoscale_view()
    to_axes = ax.transData + ax.transAxes.inverted()
    heights = {solver: float(to_axes.transform(end)[1]) for solver, end in ends.items()}
    solvers = sorted(heights, key=lambda solver: heights[solver])
    for solver, height in zip(solvers, apart([heights[solver] for solver in solvers], GAP), strict=True):
        colour = line_style(solver)["color"]
        ax.annotate(
            solver,
            xy=(ends[solver][0], ends[solver][1]),
            xytext=(LABELS_AT, height),
            textcoords="axes fraction",
            color=colour,
            va="center",
            fontproperties=style.SMALL_FONT,
            annotation_clip=False,
            arrowprops=LEADER | {"color": colour},
        )


def apart(heights: Sequence[float], gap: float) -> list[float]:
    """Increasing ``heights`` moved so that neighbours are at least ``gap`` apart, near 0 … 1 as far as they fit."""
    top = max(1.0, (len(heights) - 1) * gap)
    placed: list[float] = []
    for height in heights:
        placed.append(max(height, placed[-1] + gap) if placed else height)
    ceiling = top
    for i in reversed(range(len(placed))):
        placed[i] = min(placed[i], ceiling)
        ceiling = placed[i] - gap
    return placed


def _with_subscripts(title: str) -> str:
    """``title`` with small digits set by TeX, because the font has none."""
    return re.sub("[₀-₉]", lambda digit: f"$_{'₀₁₂₃₄₅₆₇₈₉'.index(digit[0])}$", title)
