"""A result against one of the numbers that a study changes."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex

from ...interface.status import Status
from ..palette import COMPONENTS
from ..style import named
from .axes import COLOURS, heading, scale, study_axes
from .failures import make_room, marks, names_of, outcomes
from .results import label_of, values_of
from .rows import PictureError, Rows, at_fixed, rows_of, sample
from .symbols import Labels, number_label

if TYPE_CHECKING:
    import xarray

SIZE = (5.2, 3.6)
MOST_DRAWN = 20_000
MOST_DOTTED = 60
MOST_CURVES = 6


def sweep_slice(
    data: "xarray.Dataset",
    result: str,
    against: str,
    ax: Axes | None = None,
    *,
    by: str | None = None,
    at: Mapping[str, float] | None = None,
    labels: Labels = None,
) -> Axes:
    """A result of a study against one of its numbers; rows that failed are marked by their status on the lower edge.

    The points of a scattered axis are not joined. The title says where the other axes are fixed.

    **Arguments:**

    - ``data``: from ``xarray.open_zarr`` of a store.
    - ``result``: such as ``"z[0]"``, ``"friction_needed"`` or ``"steps"``; components of a state are final values.
    - ``against``: the path of the number on the horizontal axis.
    - ``by``: the path of a number of another axis, with a curve for each of at most six of its points.
    - ``at``: the numbers at which the other axes are fixed, by path; the nearest computed ones are used. By default an
      axis is fixed at the middle one of its points at which a row succeeded, a scattered one at the first.
    - ``labels``: labels of paths and results; by default the paper's symbols, with units.

    **Raises:** :class:`PictureError` when nothing can be drawn, and for an unknown result or path, listing the known
    ones; ``ValueError`` when ``ax`` is three-dimensional.
    """
    rows = rows_of(data)
    rows, notes = at_fixed(rows, _free(rows, against, by), at, labels)
    rows = rows if by is None else _few(rows, by)
    outcome = outcomes(rows.status, values_of(rows, result))
    names, (drawn, left_out) = names_of(outcome), sample(rows, MOST_DRAWN)
    rows, outcome = rows.chosen(drawn), outcome[drawn]
    numbers, values = rows.number(against), np.where(outcome == Status.SUCCESS, values_of(rows, result), np.nan)
    ax, keys = study_axes(rows.data, ax, SIZE), []
    look = {"linestyle": "none" if rows.is_scattered(against) else "-", **_markers(rows, against)}
    for label, which, colour in _curves(rows, by, labels):
        order = which[np.argsort(numbers[which], kind="stable")]
        lines = ax.plot(numbers[order], values[order], color=colour, linewidth=1.2, label=label or None, **look)
        keys += lines if label else []
    scale(ax.xaxis, rows.is_logarithmic(against), numbers)
    make_room(ax, names)
    keys += marks(ax, numbers, None, outcome, names)
    named(ax, number_label(against, labels), label_of(data, result, labels))
    heading(ax, notes + left_out, keys)
    return ax


def _free(rows: Rows, against: str, by: str | None) -> set[int]:
    free = {rows.axis_of(against)}
    if by is None:
        return free
    if rows.axis_of(by) in free:
        raise PictureError(
            f"Argument `by` must be a number of another axis than `{against}`, but `{by}` changes together with it."
        )
    return free | {rows.axis_of(by)}


def _few(rows: Rows, by: str) -> Rows:
    """The rows at a few points of the axis of ``by``, equally spaced."""
    along = rows.indices[:, rows.axis_of(by)]
    points = np.unique(along)
    places = np.linspace(0, len(points) - 1, min(len(points), MOST_CURVES)).round().astype(int)
    return rows.chosen(np.isin(along, points[places]))


def _curves(rows: Rows, by: str | None, labels: Labels) -> Iterator[tuple[str, np.ndarray, str]]:
    """The label of each curve, the indices of its rows, and its colour."""
    if by is None:
        yield "", np.arange(len(rows)), COMPONENTS[0]
        return
    numbers = rows.number(by)
    points = np.unique(numbers)
    for number, colour in zip(points, colormaps[COLOURS](np.linspace(0.0, 0.85, len(points))), strict=True):
        yield (
            f"{number_label(by, labels, with_unit=False)} = {number:.4g}",
            np.flatnonzero(numbers == number),
            to_hex(colour),
        )


def _markers(rows: Rows, against: str) -> dict[str, Any]:
    """Dots if a curve has few points, or if no line joins them."""
    few = len(np.unique(rows.number(against))) <= MOST_DOTTED
    dotted = few or rows.is_scattered(against)
    return {"marker": "o" if dotted else "", "markersize": 3.5 if few else 1.5, "rasterized": not few}
