"""The Axes of a study's figure, and the colour, mark and hatching of each status of rows that failed."""

import textwrap
import tomllib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D

from ...files.scenario.units import read_units
from ...interface.status import Status
from ..style import ABOVE, SMALL_FONT, caption, colour_bar, in_words, number_decades, plane_axes

if TYPE_CHECKING:
    import xarray

_LETTERS = 62
MANY_VALUES = 1000
KEY = 5.0
ROW_OF_MARKS = 0.045  # its height, of that of the axes
NOT_FINITE = -2  # a row that succeeded, but whose result is not finite
_NAMES = {NOT_FINITE: "not finite"}


def title_of(data: "xarray.Dataset") -> str:
    """Returns the title of a study, or of its scenario, or else names the scenario's kind."""
    document = _scenario_of(data)
    return data.attrs.get("title") or document.get("title") or f"A study of a {document.get('kind', 'system')}"


def caption_of_study(figure: Any, data: "xarray.Dataset") -> None:
    """Writes the title of a study above a figure, and its units."""
    document = _scenario_of(data)
    units = read_units(document["units"]) if "units" in document else None
    caption(figure, title=title_of(data), units=in_words(units))


def _scenario_of(data: "xarray.Dataset") -> dict[str, Any]:
    return tomllib.loads(data.attrs.get("scenario", ""))


def study_axes(data: "xarray.Dataset", ax: Axes | None, size: tuple[float, float]) -> Axes:
    """Returns ``ax``, or the Axes of a new figure that says which study it shows.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    axes = plane_axes(ax, size)
    if ax is None:
        caption_of_study(axes.figure, data)
    return axes


def write_heading(ax: Axes, sentences: Sequence[str], keys: Sequence[Any] = (), most: int = 3) -> None:
    """Writes above the axes what is fixed and left out, and below that the legend of ``keys``, ``most`` in a row."""
    title = "\n".join(textwrap.wrap("; ".join(sentences), _LETTERS))
    if not keys:
        ax.set_title(title, fontproperties=SMALL_FONT)
        return
    wide: dict[str, Any] = {"handlelength": 1.6, "columnspacing": 1.2, "handletextpad": 0.5}
    columns = min(len(keys), most)
    ax.legend(handles=keys, ncols=columns, title=title or None, title_fontproperties=SMALL_FONT, **ABOVE, **wide)


def set_scale(axis: Axis, logarithmic: bool, values: np.ndarray) -> None:
    """Gives ``axis`` a logarithmic scale if its positive ``values`` are spaced logarithmically."""
    values = values[np.isfinite(values)]
    if not logarithmic or not values.size or values.min() <= 0:
        return
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})  # pyright: ignore[reportAttributeAccessIssue]
    number_decades(axis, float(values.max() / values.min()))


def add_colour_bar(ax: Axes, shown: ScalarMappable, label: str) -> None:
    """Adds a colour bar with the scale of the colours."""
    bar = colour_bar(ax, shown, label)
    if isinstance(shown.norm, LogNorm):
        low, high = bar.ax.get_ylim()
        number_decades(bar.ax.yaxis, high / low)


def edges_of(values: Float[np.ndarray, " points"], logarithmic: bool) -> Float[np.ndarray, " edges"]:
    """Returns the edges of cells around ``values``, halfway between them, or between their logarithms."""
    # The halves between logarithms are geometric means.
    if logarithmic and values[0] > 0:
        return np.exp(edges_of(np.log(values), False))
    if len(values) == 1:
        return values[0] + np.array([-0.5, 0.5])
    between = (values[1:] + values[:-1]) / 2
    # The outer edges are as far outside as the inner ones are inside.
    return np.concatenate([[2 * values[0] - between[0]], between, [2 * values[-1] - between[-1]]])


class Look(NamedTuple):
    """The colour, the mark and the hatching of a status."""

    colour: str
    marker: str
    hatch: str


# Distinguishable from one another and from the colours of viridis, also in grey and for colour-blind readers.
LOOKS = {
    NOT_FINITE: Look("#882255", "1", "..."),
    Status.MAX_STEPS: Look("#BB5566", "x", "////"),
    Status.NOT_FINITE: Look("black", "+", "xxxx"),
    Status.IMPOSSIBLE: Look("0.55", "s", "\\\\\\\\"),
    Status.SOLVER_FAILED: Look("#D55E00", "2", "----"),
    Status.LEFT_SHELL: Look("#CC79A7", "v", "||||"),
    Status.DETACHED: Look("#332288", "^", "++++"),
    Status.SLIPPED: Look("#999933", "p", "oo"),
    Status.EVENT: Look("0.3", "d", "**"),
    Status.JAMMED: Look("#009E73", "P", "xx"),
    Status.CHATTERED: Look("#0072B2", "*", "\\\\||"),
    Status.LEFT_SURFACE: Look("#88CCEE", ">", "//.."),
    Status.WEDGED: Look("#DDCC77", "<", "--.."),
    Status.TOPPLED: Look("#AA4499", "h", "||.."),
}


def outcomes(status: Int[np.ndarray, " rows"], values: Float[np.ndarray, " rows"]) -> Int[np.ndarray, " rows"]:
    """Returns the status of each row: SUCCESS where a row that an event ended has a finite value, and ``NOT_FINITE``
    where one that reached its end has none.
    """
    finite = np.isfinite(values)
    status = np.where((status == Status.EVENT) & finite, Status.SUCCESS, status)
    return np.where((status == Status.SUCCESS) & ~finite, NOT_FINITE, status)


def present(outcome: Int[np.ndarray, " rows"]) -> list[int]:
    """Returns the codes of the failures among the outcomes."""
    return [code for code in np.unique(outcome).tolist() if code != Status.SUCCESS]


def names_of(outcome: Int[np.ndarray, " rows"]) -> dict[int, str]:
    """Returns the legend entry of each failure among the outcomes: its name, and how many rows have it."""
    return {code: f"{_NAMES.get(code) or Status(code).name} ({np.sum(outcome == code):,})" for code in present(outcome)}


def mark_failures(
    ax: Axes,
    right: Float[np.ndarray, " rows"],
    up: Float[np.ndarray, " rows"] | None,
    outcome: Int[np.ndarray, " rows"],
    names: Mapping[int, str],
    size: float = KEY,
) -> list[Line2D]:
    """Draws a mark for each row that failed, and returns a legend key for each of the failures in ``names``.

    Without ``up``, each failure has a row of marks above the lower edge.
    """
    # Many marks are small, or they would cover each other.
    keys, size = [], size if len(outcome) <= MANY_VALUES else min(size, 2.0)
    for k, (code, name) in enumerate(names.items()):
        look, here = LOOKS[code], outcome == code
        on_the_edge: dict[str, Any] = {"transform": ax.get_xaxis_transform()} if up is None else {}
        mark: dict[str, Any] = {"marker": look.marker, "color": look.colour, "markerfacecolor": "none"}
        ax.plot(
            right[here],
            np.full(np.sum(here), (k + 0.6) * ROW_OF_MARKS) if up is None else up[here],
            **mark,
            markersize=size,
            markeredgewidth=0.2 * size,
            linestyle="none",
            label=name,
            zorder=4,
            rasterized=True,
            **on_the_edge,
        )
        keys.append(Line2D([], [], **mark, markersize=KEY, linestyle="none", label=name))
    return keys


def make_room(ax: Axes, names: Mapping[int, str]) -> None:
    """Extends the axes downwards, so that rows of marks fit there."""
    share = ROW_OF_MARKS * len(names)
    low, high = ax.get_ylim()
    if share and ax.get_yscale() == "linear":
        # The share of the marks in the axis after it has been extended.
        ax.set_ylim(low - share / (1 - share) * (high - low), high)


def hatching(code: int) -> dict[str, Any]:
    """Returns the look of cells with a failure."""
    return {"facecolor": LOOKS[code].colour, "edgecolor": "white", "hatch": LOOKS[code].hatch, "linewidth": 0.0}
