"""The look of the figures, passed to each artist: matplotlib's own settings are not touched."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

INK = "black"
SHELL = "0.45"
FAINT = "0.82"
TRAIL = "#BB5566"
# Okabe and Ito's colours for the masses, Tol's high-contrast ones for everything else: both are told
# apart by colour-blind readers and in grey.
MASSES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
COMPONENTS = ("#004488", "#BB5566", "#DDAA33")
DASHES = ("-", (0, (6, 1.5)), (0, (3, 1, 1, 1)), (0, (1, 1)))

LABEL = FontProperties(family="STIXGeneral", math_fontfamily="stix", size=11)
SMALL = FontProperties(family="STIXGeneral", math_fontfamily="stix", size=10)
WIDE, SQUARE = (4.6, 2.9), (4.4, 4.4)


def mass_colour(i: int) -> str:
    """The colour of mass i = 1 … n, the same one in every figure."""
    return MASSES[(i - 1) % len(MASSES)]


def mass_line(i: int, **changes: Any) -> dict[str, Any]:
    """The line of mass i = 1 … n: its colour, and dashes where the colours start anew; with ``changes``."""
    dashes = DASHES[(i - 1) // len(MASSES) % len(DASHES)]
    return {"color": mass_colour(i), "linestyle": dashes, "linewidth": 1.2} | changes


def plane_axes(ax: Axes | None, size: tuple[float, float] = WIDE) -> Axes:
    """``ax``, or the Axes of a new figure, with thin ticks and without a box.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    if ax is None:
        ax = Figure(figsize=size, layout="constrained").add_subplot()
    if isinstance(ax, Axes3D):
        raise ValueError(f"Argument `ax` must be a plane Axes, but it is a {type(ax).__name__}; omit it for a new one.")
    ax.tick_params(width=0.6, length=3, labelsize=9, labelfontfamily="STIXGeneral")
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_linewidth(0.6)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    return ax


def space_axes(ax: Axes | None, size: tuple[float, float] = SQUARE) -> Axes3D:
    """``ax``, or the three-dimensional Axes of a new figure, seen from afar and with white panes.

    **Raises:** ``ValueError`` when ``ax`` is not three-dimensional.
    """
    if ax is None:
        ax = Figure(figsize=size, layout="constrained").add_subplot(projection="3d", computed_zorder=False)
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


def cube(ax: Axes3D, radius: float, names: str) -> None:
    """Shows |coordinates| ≤ ``radius`` at one scale, with the axes named ``names`` and a subscript."""
    limits, ticks = (-1.04 * radius, 1.04 * radius), (-radius, 0.0, radius)
    ax.set(xlim=limits, ylim=limits, zlim=limits, xticks=ticks, yticks=ticks, zticks=ticks)
    ax.set_box_aspect((1, 1, 1))
    named(ax, *(rf"$\mathbf{{{names}}}_{j}$" for j in (1, 2, 3)))


def named(ax: Axes, *labels: str) -> None:
    """Labels the axes of ``ax`` in the order x, y, z."""
    in_space: dict[str, Any] = {"labelpad": -3, "rotation": 0} if isinstance(ax, Axes3D) else {}
    for letter, label in zip("xyz", labels, strict=False):
        if in_space:
            getattr(ax, f"{letter}axis").set_rotate_label(False)
        getattr(ax, f"set_{letter}label")(label, fontproperties=LABEL, **in_space)


def legend_above(ax: Axes, most: int = 5) -> None:
    """A legend above the axes, where it hides nothing; none where nothing is labelled. ``most`` labels to a row."""
    handles, labels = ax.get_legend_handles_labels()
    if labels:
        rows = math.ceil(len(labels) / max(most, math.ceil(len(labels) / 4)))
        ax.legend(
            handles,
            labels,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            ncols=math.ceil(len(labels) / rows),
            frameon=False,
            prop=SMALL,
            handlelength=1.3,
            columnspacing=1.0,
            handletextpad=0.4,
        )


def colour_bar(ax: Axes, shown: ScalarMappable, label: str, **options: Any) -> Colorbar:
    """A colour bar beside the axes, with thin ticks."""
    bar = ax.figure.colorbar(shown, ax=ax, **options)
    bar.set_label(label, fontproperties=LABEL)
    bar.ax.tick_params(width=0.6, length=3, labelsize=9, labelfontfamily="STIXGeneral")
    bar.outline.set_linewidth(0.6)  # pyright: ignore[reportAttributeAccessIssue]
    return bar


def write(ax: Axes, at: Sequence[float] | Float[np.ndarray, " d"], sentence: str, **options: Any) -> Text:
    """Writes into a plane or a three-dimensional Axes."""
    options = {"fontproperties": SMALL} | options
    return ax.text(*at, sentence, **options)  # pyright: ignore[reportCallIssue]
