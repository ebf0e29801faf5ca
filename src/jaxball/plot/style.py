"""The style of the figures, passed to each artist, because matplotlib's own settings are not changed.

A notebook shows figures, and Axes of a figure of their own, where a cell ends in them. They need no backend of
matplotlib's and are not registered with pyplot: IPython asks an object for ``_repr_png_`` where nothing else is
registered for its class.
"""

import io
import math
import re
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from matplotlib.transforms import Bbox, TransformedBbox
from mpl_toolkits.mplot3d import Axes3D

from ..files.scenario.units import Units
from ..physics.body import AbstractBody
from ..physics.system import AbstractSystem
from ..simulation.trajectory import Trajectory
from .palette import Dashes, mass_look


class ShownFigure(Figure):
    """A figure that a notebook shows."""

    def _repr_png_(self) -> bytes:
        return _png(self)


class ShownAxes(Axes):
    """Plane Axes whose figure a notebook shows."""

    def _repr_png_(self) -> bytes:
        return _png(self.figure)


class ShownAxes3D(Axes3D):
    """Three-dimensional Axes whose figure a notebook shows."""

    def _repr_png_(self) -> bytes:
        return _png(self.figure)


def _png(figure: Any) -> bytes:
    stream = io.BytesIO()
    # Not that of a user's settings for files: as large as on a screen.
    figure.savefig(stream, format="png", dpi=figure.dpi)
    return stream.getvalue()


DASH = 7.0  # of lines that lie on one another, in widths of the line
SHARED = "bevel"  # the joins of their dashes, by which the legend recognises them

LABEL = FontProperties(family="STIXGeneral", math_fontfamily="stix", size=11)
SMALL_FONT = FontProperties(family="STIXGeneral", math_fontfamily="stix", size=10)
# Titles are the users', and may have characters that STIX lacks.
TINY_FONT = FontProperties(family=["STIXGeneral", "DejaVu Sans"], math_fontfamily="stix", size=8)
ABOVE: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "frameon": False, "prop": SMALL_FONT}
CAPTION: dict[str, Any] = {"fontproperties": TINY_FONT, "color": "0.35"}
WIDE_FIGURE, SQUARE = (4.6, 3.1), (4.6, 4.7)
WIDE_RANGE = 1e3  # range of a logarithmic axis on which powers of ten are enough ticks
EDGE = 0.02  # of a plane Axes, by which a curve may exceed it
LETTERS = 20  # of a caption in an inch
COLOURS = "viridis"  # of a number
ATTITUDE = r"\varphi"  # the local coordinates of an attitude

Captioned: TypeAlias = AbstractSystem | Trajectory[Any, Any] | None  # what a caption can name


def caption(figure: Any, system: AbstractSystem | None = None, title: str = "", units: str = "") -> None:
    """Writes above a figure which system it shows, and in what units.

    **Arguments:**

    - ``figure``: a figure; its caption is replaced if it has one.
    - ``system``: the system; its numbers are dimensionless where m_0 = r = g = 1.
    - ``title``: the name of the system, such as a scenario's title, shown instead of a description.
    - ``units``: those that its scenario states, in words.
    """
    lines = textwrap.wrap(subject(system, title, units), int(LETTERS * figure.get_figwidth()), break_on_hyphens=False)
    figure.suptitle("\n".join(lines), linespacing=1.15, **CAPTION)


def captioned(
    draw: Callable[[], Axes | Figure], system: AbstractSystem, title: str = "", units: str = ""
) -> Callable[[], Axes | Figure]:
    """Makes a function that draws the same figure, or the same Axes of one, with a caption as by :func:`caption`."""

    def draw_with_caption() -> Axes | Figure:
        drawn = draw()
        caption(drawn if isinstance(drawn, Figure) else drawn.figure, system, title, units)
        return drawn

    return draw_with_caption


def caption_of(figure: Any, shown: Captioned) -> None:
    """Writes above a figure which system it shows; of a run the title of its scenario, and the units that this states.

    Of nothing, nothing is written.
    """
    if isinstance(shown, AbstractSystem):
        caption(figure, shown)
    elif shown is not None:
        caption(figure, shown.system, title_of(shown), describe_units(shown))


def subject(system: AbstractSystem | None, title: str = "", units: str = "") -> str:
    """Says which system a figure shows, and in what units."""
    # A $ of a title would begin a formula.
    shown = title.replace("$", r"\$") or ("" if system is None else describe(system))
    units = units or _units(system, title)
    return f"{shown}; {units}" if shown else units


def describe_units(trajectory: Trajectory[Any, Any]) -> str:
    """Describes the units that the scenario of a run states; empty if it states none."""
    return "" if trajectory.scenario is None else in_words(trajectory.scenario.units)


def in_words(units: Units | None) -> str:
    """Describes units in words; empty without any."""
    if units is None:
        return ""
    return str(units) if units.is_dimensionless else f"in {units}"


def title_of(trajectory: Trajectory[Any, Any]) -> str:
    """Returns the title of the scenario of a run; empty if it has none."""
    return "" if trajectory.scenario is None else trajectory.scenario.title


def describe(system: AbstractSystem) -> str:
    """Describes a system in words, as the beginning of a sentence."""
    words = system.describe()
    return words[0].upper() + words[1:]


def _units(system: AbstractSystem | None, title: str) -> str:
    if dimensionless(system):
        return "dimensionless,\N{NO-BREAK SPACE}$m_0=r=g=1$"
    return "in the units of the scenario" if title or system is None else "in the units of its parameters"


def dimensionless(system: AbstractSystem | None) -> bool:
    """Returns whether the system is a body with m_0 = r = g = 1."""
    if not isinstance(system, AbstractBody):
        return False
    return all(np.all(np.asarray(getattr(system, name)) == 1.0) for name in ("mass", "radius", "gravity"))


def linestyle(dashes: Dashes) -> Any:
    """Translates dashes into the words of matplotlib."""
    return (0, dashes) if dashes else "-"


def mass_line(i: int, **changes: Any) -> dict[str, Any]:
    """Returns the line style of mass i = 1 … n: its colour and its dashes, with ``changes``."""
    look = mass_look(i)
    return {"color": look.colour, "linestyle": linestyle(look.dashes), "linewidth": 1.2} | changes


def plane_axes(
    ax: Axes | None,
    size: tuple[float, float] = WIDE_FIGURE,
    shown: Captioned = None,
) -> Axes:
    """Returns ``ax``, or the Axes of a new figure that says which system or run it shows, with thin ticks and without a
    box.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    if ax is None:
        ax = _new(size, shown).add_subplot(axes_class=ShownAxes)
    if isinstance(ax, Axes3D):
        raise ValueError(f"Argument `ax` must be a plane Axes, but it is a {type(ax).__name__}; omit it for a new one.")
    ax.tick_params(width=0.6, length=3, labelsize=9, labelfontfamily="STIXGeneral")
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_linewidth(0.6)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
        axis.get_offset_text().set(fontfamily="STIXGeneral", fontsize=9)
    return ax


def space_axes(
    ax: Axes | None,
    size: tuple[float, float] = SQUARE,
    shown: Captioned = None,
) -> Axes3D:
    """Returns ``ax``, or three-dimensional Axes of a new figure as in :func:`plane_axes`, in parallel projection.

    **Raises:** ``ValueError`` when ``ax`` is not three-dimensional.
    """
    if ax is None:
        ax = _new(size, shown).add_subplot(axes_class=ShownAxes3D, computed_zorder=False)
    if not isinstance(ax, Axes3D):
        raise ValueError(
            "Argument `ax` must be a three-dimensional Axes, made with projection='3d', but it is a "
            f"{type(ax).__name__}; omit it for a new one."
        )
    ax.set_proj_type("ortho")
    ax.tick_params(labelsize=8, labelfontfamily="STIXGeneral", pad=0)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.pane.set(facecolor="white", edgecolor="0.8", linewidth=0.5)  # pyright: ignore
        axis.line.set(color="0.6", linewidth=0.6)  # pyright: ignore
    ax.grid(False)
    return ax


def _new(size: tuple[float, float], shown: Captioned) -> Figure:
    figure = ShownFigure(figsize=size, layout="constrained")
    caption_of(figure, shown)
    return figure


def stacked_panels(count: int, height: float, around: float, shown: Captioned) -> tuple[Figure, np.ndarray]:
    """Makes a figure of panels over one another with the same horizontal axis; heights are in inches."""
    figure = _new((WIDE_FIGURE[0], around + height * count), shown)
    return figure, figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]


def up_to_ticks(ax: Axes, low: float = math.inf) -> None:
    """Ends the vertical axis at ticks that enclose everything drawn, and ``low``."""
    drawn = ax.dataLim.intervaly
    low, high = min(low, float(drawn[0])), float(drawn[1])
    if not np.isfinite([low, high]).all():
        return
    if high - low <= 1e-9 * max(abs(low), abs(high)):  # a constant is shown relative to 0, and 0 relative to ±1
        low, high = (min(low, 0.0), max(high, 0.0)) if low or high else (-1.0, 1.0)
    locator = ax.yaxis.get_major_locator()
    # A curve may exceed a tick by less than the width of its line, unless the axis ending there would get other ticks.
    for slack in (0.005 * (high - low), 0.0):
        bottom, top = low + slack, high - slack
        for _ in range(5):  # new limits may have new ticks
            ticks = locator.tick_values(bottom, top)
            if (ticks[0], ticks[-1]) == (bottom, top):
                break
            bottom, top = float(ticks[0]), float(ticks[-1])
        ends_at = min(bottom, low), max(top, high)
        shown = [tick for tick in locator.tick_values(*ends_at) if ends_at[0] <= tick <= ends_at[1]]
        if (shown[0], shown[-1]) == (bottom, top):
            break
    ax.set_ylim(*ends_at)
    for line in ax.lines:  # a line on the edge is not clipped
        line.set_clip_box(TransformedBbox(Bbox([[-EDGE, -EDGE], [1 + EDGE, 1 + EDGE]]), ax.transAxes))


def number_decades(axis: Axis, ratio: float) -> None:
    """Labels a logarithmic axis whose ends have this ratio: a short one also between powers of ten."""
    if ratio < WIDE_RANGE:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: _upright(number(value))))
    axis.set_minor_formatter(NullFormatter())


def _upright(tex: str) -> str:
    """Returns a number in the font of the other ticks."""
    return rf"$\mathdefault{{{tex}}}$" if "^" in tex else tex


def number(x: float) -> str:
    """Formats a number in TeX, with a power of ten if that is shorter."""
    text = f"{x:.7g}"
    mantissa, _, exponent = text.partition("e")
    if not exponent:
        return text
    power = f"10^{{{int(exponent)}}}"
    return power if mantissa == "1" else rf"{mantissa} \times {power}"


def cube(ax: Axes3D, radius: float, names: str) -> None:
    """Shows |coordinates| ≤ ``radius`` at one scale, with the axes named ``names`` and a subscript."""
    limits, ticks = (-1.04 * radius, 1.04 * radius), (-radius, 0.0, radius)
    ax.set(xlim=limits, ylim=limits, zlim=limits, xticks=ticks, yticks=ticks, zticks=ticks)
    names_of = [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks]
    # The ends of two axes meet in the lower corner, where two long numbers would touch.
    first = names_of[0] if len(names_of[0]) < 4 else ""
    ax.set(xticklabels=names_of, yticklabels=[first, *names_of[1:]], zticklabels=names_of)
    ax.set_box_aspect((1, 1, 1))
    label_axes(ax, *(rf"$\mathbf{{{names}}}_{j}$" for j in (1, 2, 3)))


_POWER, _SUPERSCRIPT = r"\^(-?\d+)", r"$^{\1}$"  # of a unit


def label_with(words: str, unit: str) -> str:
    """Returns the label of an axis with a unit such as ``"m s^-1"``, if there is one."""
    return words if unit in ("", "1") else f"{words} ({re.sub(_POWER, _SUPERSCRIPT, unit)})"


def label_of_run(run: Trajectory[Any, Any], words: str, dimension: str) -> str:
    """Returns the label of an axis, with a unit where the scenario of the run states them.

    ``dimension`` is that of the axis, in words such as ``"length/time"``.
    """
    units = None if run.scenario is None else run.scenario.units
    return words if units is None else label_with(words, units.of(dimension))


def label_axes(ax: Axes, *labels: str) -> None:
    """Labels the axes of ``ax`` in the order x, y, z."""
    in_space: dict[str, Any] = {"labelpad": -3, "rotation": 0} if isinstance(ax, Axes3D) else {}
    for letter, label in zip("xyz", labels, strict=False):
        if in_space:
            getattr(ax, f"{letter}axis").set_rotate_label(False)
        getattr(ax, f"set_{letter}label")(label, fontproperties=LABEL, **in_space)


def mark_ends(
    ax: Axes, points: Float[np.ndarray, "T d"], colour: str, *, labelled: bool = False, size: float = 5.0, **look: Any
) -> None:
    """Draws a ring at the start of a path and a square at its end, so that both can be seen where they coincide."""
    start, end = ("start", "end") if labelled else (None, None)
    look = {"color": colour, "linestyle": "none"} | look
    ax.plot(*points[:1].T, "o", ms=size, mew=1.0, markerfacecolor="white", label=start, **look)
    ax.plot(*points[-1:].T, "s", ms=0.6 * size, mew=0.0, label=end, **look)


def sharing(k: int, n: int) -> dict[str, Any]:
    """Returns the dashes of the k-th of ``n`` coinciding lines, of which the first is solid and beneath the others.

    A line that coincides with no other keeps its own.
    """
    if k == 0:
        return {} if n == 1 else {"linestyle": "-", "dash_joinstyle": SHARED}
    return {"linestyle": (k * DASH, (DASH, (n - 1) * DASH)), "dash_capstyle": "butt", "dash_joinstyle": SHARED}


def legend_above(ax: Axes, most: int = 5) -> None:
    """Draws a legend above the axes, where it hides nothing, with up to ``most`` entries in a row; nothing without
    labels.
    """
    handles, labels = ax.get_legend_handles_labels()
    if labels:
        # At most four rows, however long these become.
        rows = math.ceil(len(labels) / max(most, math.ceil(len(labels) / 4)))
        columns = math.ceil(len(labels) / rows)
        # matplotlib fills columns, but readers read rows.
        order = [k for column in range(columns) for k in range(column, len(labels), columns)]
        drawn = [handles[k] for k in order]
        narrow: dict[str, Any] = {"handlelength": 1.3, "columnspacing": 1.0, "handletextpad": 0.4}
        legend = ax.legend(drawn, [labels[k] for k in order], ncols=columns, **ABOVE, **narrow)
        for handle, line in zip(legend.legend_handles, drawn, strict=True):
            if isinstance(handle, Line2D) and isinstance(line, Line2D) and line.get_dash_joinstyle() == SHARED:
                handle.set_linestyle("-")  # whose dashes may be longer than the handle


def finish_path(ax: Axes, right: str = "$z_1$", up: str = "$z_2$", *, most: int = 5) -> Axes:
    """Shows a path in the plane at one scale, with room around it, names of its axes and a legend."""
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    label_axes(ax, right, up)
    legend_above(ax, most)
    return ax


class ColourScale(NamedTuple):
    """A number that determines the colours of the bodies in a view.

    **Arguments:**

    - ``name``: the name of the number, such as ``"body.mass"``.
    - ``values``: its value for each body, in their order; NaN, for unknown, is grey.
    - ``logarithmic``: whether colours are spaced by its logarithm.

    **Example:**

    >>> from jaxball.plot import ColourScale
    >>> ColourScale("body.mass", [0.5, 1.0, 2.0], logarithmic=True).values
    [0.5, 1.0, 2.0]
    """

    name: str
    values: Sequence[float]
    logarithmic: bool = False


def norm_of(values: np.ndarray, logarithmic: bool = False) -> Normalize:
    """Returns the map to colours that covers the finite ones of ``values``."""
    values = values[np.isfinite(values)]
    least, most = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    return LogNorm(least, most) if logarithmic and 0 < least < most else Normalize(least, most)


def zero_line(ax: Axes) -> None:
    """Draws a thin horizontal line at zero."""
    ax.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)


def colour_bar(ax: Axes, shown: ScalarMappable, label: str, **options: Any) -> Colorbar:
    """Draws a colour bar beside the axes, with thin ticks."""
    bar = ax.figure.colorbar(shown, ax=ax, **options)
    bar.set_label(label, fontproperties=LABEL)
    bar.ax.tick_params(width=0.6, length=3, labelsize=9, labelfontfamily="STIXGeneral")
    bar.outline.set_linewidth(0.6)  # pyright: ignore[reportAttributeAccessIssue]
    return bar


def write(ax: Axes, at: Sequence[float] | Float[np.ndarray, " d"], sentence: str, **options: Any) -> Text:
    """Writes into a plane or a three-dimensional Axes."""
    options = {"fontproperties": SMALL_FONT} | options
    return ax.text(*at, sentence, **options)  # pyright: ignore[reportCallIssue]
