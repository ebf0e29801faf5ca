"""Work–precision diagrams: the error of the path over the processor time for a unit of simulated time."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...interface.output import replacing
from ...plot import palette, style
from .contract import Case

if TYPE_CHECKING:
    from .run import Row

SIZE = (7.2, 4.4)
# Okabe and Ito's colours (2008), which colour-blind readers can distinguish.
COLOURS = {"jaxball": "#D55E00", "MuJoCo": "#0072B2", "Drake": "#009E73", "PyBullet": "#CC79A7"}
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "h")


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
            _line(ax, engine, setting, MARKERS[place % len(MARKERS)], rows)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.grid(True, color=palette.FAINT, linewidth=0.4)
    ax.set_axisbelow(True)
    style.label_axes(ax, "processor time for a unit of simulated time [s]", "largest error of the path [radii]")
    ax.set_title(f"{case.title[0].upper()}{case.title[1:]}", fontproperties=style.LABEL, loc="left")
    ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False, prop=style.SMALL)
    figure = ax.figure
    assert isinstance(figure, Figure)
    return figure


def _line(ax: Axes, engine: str, setting: str, marker: str, rows: Sequence["Row"]) -> None:
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
