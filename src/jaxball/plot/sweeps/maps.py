"""A result over two of the numbers that a study changes."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from ...interface.status import Status
from ..style import named
from .axes import COLOURS, coloured, edges_of, heading, norm_of, scale, study_axes
from .failures import LOOKS, MANY, marks, names_of, outcomes, patch
from .results import label_of, values_of
from .rows import PictureError, Rows, at_fixed, rows_of, sample
from .symbols import Labels, number_label

if TYPE_CHECKING:
    import xarray

SIZE = (5.4, 4.2)
MOST_CELLS = 500  # to each side
MOST_DOTS = 20_000


def sweep_map(
    data: "xarray.Dataset",
    result: str,
    right: str,
    up: str,
    ax: Axes | None = None,
    *,
    at: Mapping[str, float] | None = None,
    labels: Labels = None,
) -> Axes:
    """A result of a study in colours over two of its numbers; rows that failed are hatched by their status.

    Crossed axes are drawn as cells, white where nothing was computed; two numbers of a scattered axis as dots, with
    marks for rows that failed. The title says where the other axes are fixed.

    **Arguments:**

    - ``data``, ``result``, ``ax``, ``at``, ``labels``: as for :func:`sweep_slice`.
    - ``right``, ``up``: the paths of both numbers.

    **Raises:** as :func:`sweep_slice`.
    """
    if right == up:
        raise PictureError(f"Argument `up` must be a number other than `right`, but both are `{up}`.")
    rows = rows_of(data)
    rows, notes = at_fixed(rows, {rows.axis_of(right), rows.axis_of(up)}, at, labels)
    crossed = rows.axis_of(right) != rows.axis_of(up) and not (rows.is_scattered(right) or rows.is_scattered(up))
    ax = study_axes(rows.data, ax, SIZE)
    shown, keys, more = (_cells if crossed else _dots)(ax, rows, result, right, up)
    for axis, path in ((ax.xaxis, right), (ax.yaxis, up)):
        scale(axis, rows.is_logarithmic(path), rows.number(path))
    coloured(ax, shown, label_of(data, result, labels))
    named(ax, number_label(right, labels), number_label(up, labels))
    heading(ax, notes + more, keys, most=2)
    return ax


def _cells(ax: Axes, rows: Rows, result: str, right: str, up: str) -> tuple[Any, list[Any], list[str]]:
    names, size = names_of(outcomes(rows.status, values_of(rows, result))), len(rows)
    for path in (right, up):
        rows = _with_fewer_points(rows, path)
    notes = [] if len(rows) == size else [f"{len(rows):,} of {size:,} rows drawn"]
    (columns, x), (lines, y) = _ordered(rows, right), _ordered(rows, up)
    values = values_of(rows, result)
    outcome = outcomes(rows.status, values)
    good = outcome == Status.SUCCESS
    grid = np.full((len(y), len(x)), np.nan)
    grid[lines[good], columns[good]] = values[good]
    edges = edges_of(x, rows.is_logarithmic(right)), edges_of(y, rows.is_logarithmic(up))
    shown = ax.pcolormesh(*edges, grid, cmap=COLOURS, norm=norm_of(values[good]), rasterized=True)
    for code in names:
        # Not add_patch, which would visit all corners to find limits that the mesh has already set.
        ax.add_artist(_hatched(code, columns[outcome == code], lines[outcome == code], *edges))
    return shown, [patch(*item) for item in names.items()], notes


def _with_fewer_points(rows: Rows, path: str) -> Rows:
    """The rows at every k-th point of the axis of ``path``, so that there are at most ``MOST_CELLS`` points."""
    along = rows.indices[:, rows.axis_of(path)]
    step = -(-(np.max(along) + 1) // MOST_CELLS)
    return rows.chosen(along % step == 0)


def _ordered(rows: Rows, path: str) -> tuple[np.ndarray, Float[np.ndarray, " points"]]:
    """The index of each row among the sorted values at ``path``, and these values.

    Points without a computed row have values between those of their neighbours, so that their cells stay empty.
    """
    along, numbers = rows.indices[:, rows.axis_of(path)], rows.number(path)
    known, first = np.unique(along, return_index=True)
    steps = np.diff(numbers[first])
    if not (np.all(steps > 0) or np.all(steps < 0)):
        values, places = np.unique(numbers, return_inverse=True)
        return places, values
    step = np.gcd.reduce(np.diff(known)) if len(known) > 1 else 1
    points = np.arange(known[0], known[-1] + 1, step)
    if rows.is_logarithmic(path) and np.min(numbers) > 0:
        values = np.exp(np.interp(points, known, np.log(numbers[first])))
    else:
        values = np.interp(points, known, numbers[first])
    return (along - known[0]) // step, values


def _hatched(code: int, columns: np.ndarray, lines: np.ndarray, x: np.ndarray, y: np.ndarray) -> PathPatch:
    """All cells with one status, as one patch."""
    corners = [(columns, lines), (columns + 1, lines), (columns + 1, lines + 1), (columns, lines + 1), (columns, lines)]
    points = np.stack([np.stack([x[column], y[line]], axis=-1) for column, line in corners], axis=1)
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(points))
    look = LOOKS[code]
    return PathPatch(
        Path(points.reshape(-1, 2), codes),
        facecolor=look.colour,
        edgecolor="white",
        hatch=look.hatch,
        linewidth=0.0,
        rasterized=True,
    )


def _dots(ax: Axes, rows: Rows, result: str, right: str, up: str) -> tuple[Any, list[Any], list[str]]:
    names, (drawn, notes) = names_of(outcomes(rows.status, values_of(rows, result))), sample(rows, MOST_DOTS)
    rows = rows.chosen(drawn)
    x, y, values = rows.number(right), rows.number(up), values_of(rows, result)
    outcome = outcomes(rows.status, values)
    good = outcome == Status.SUCCESS
    shown = ax.scatter(
        x[good],
        y[good],
        c=values[good],
        s=14.0 if len(rows) <= MANY else 4.0,
        cmap=COLOURS,
        norm=norm_of(values[good]),
        linewidths=0.0,
        rasterized=True,
    )
    return shown, marks(ax, x, y, outcome, names), notes
