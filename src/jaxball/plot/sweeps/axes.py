"""The Axes of a study's figure: their title and legend, the scales of their numbers, and the colours of a number."""

import textwrap
import tomllib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize

from ..style import SMALL, caption, colour_bar, number_decades, plane_axes

if TYPE_CHECKING:
    import xarray

COLOURS = "viridis"
_LETTERS = 62


def title_of(data: "xarray.Dataset") -> str:
    """The title of a study, or that of its scenario, or else the scenario's kind."""
    document = tomllib.loads(data.attrs.get("scenario", ""))
    return data.attrs.get("title") or document.get("title") or f"A study of a {document.get('kind', 'system')}"


def study_axes(data: "xarray.Dataset", ax: Axes | None, size: tuple[float, float]) -> Axes:
    """``ax``, or the Axes of a new figure that says which study it shows.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    made = plane_axes(ax, size)
    if ax is None:
        caption(made.figure, title=title_of(data))
    return made


def heading(ax: Axes, sentences: Sequence[str], keys: Sequence[Any] = (), most: int = 3) -> None:
    """Writes above the axes what is fixed and left out, and below that the legend of ``keys``, ``most`` in a row."""
    title = "\n".join(textwrap.wrap("; ".join(sentences), _LETTERS))
    if not keys:
        ax.set_title(title, fontproperties=SMALL)
        return
    ax.legend(
        handles=keys,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=min(len(keys), most),
        frameon=False,
        prop=SMALL,
        title=title or None,
        title_fontproperties=SMALL,
        handlelength=1.6,
        columnspacing=1.2,
        handletextpad=0.5,
    )


def scale(axis: Axis, logarithmic: bool, values: np.ndarray) -> None:
    """Gives ``axis`` a logarithmic scale if its positive ``values`` are spaced logarithmically."""
    values = values[np.isfinite(values)]
    if not logarithmic or not values.size or values.min() <= 0:
        return
    axis.axes.set(**{f"{axis.axis_name}scale": "log"})  # pyright: ignore[reportAttributeAccessIssue]
    number_decades(axis, float(values.max() / values.min()))


def coloured(ax: Axes, shown: ScalarMappable, label: str) -> None:
    """Adds a colour bar with the scale of the colours."""
    bar = colour_bar(ax, shown, label)
    if isinstance(shown.norm, LogNorm):
        low, high = bar.ax.get_ylim()
        number_decades(bar.ax.yaxis, high / low)


def norm_of(values: np.ndarray, logarithmic: bool = False) -> Normalize:
    """The map to colours that covers the finite ones of ``values``."""
    values = values[np.isfinite(values)]
    least, most = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    return LogNorm(least, most) if logarithmic and 0 < least < most else Normalize(least, most)


def edges_of(values: Float[np.ndarray, " points"], logarithmic: bool) -> Float[np.ndarray, " edges"]:
    """The edges of cells around ``values``, halfway between them, or between their logarithms."""
    if logarithmic and values[0] > 0:
        return np.exp(edges_of(np.log(values), False))
    if len(values) == 1:
        return values[0] + np.array([-0.5, 0.5])
    between = (values[1:] + values[:-1]) / 2
    return np.concatenate([[2 * values[0] - between[0]], between, [2 * values[-1] - between[-1]]])
