"""The figures of a study, and those that suit it written into a folder.

They are those of a result against a number, or over two of them, and of trajectories coloured by a number; ``matrix``
has the one of all against one another.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgba
from matplotlib.mathtext import MathTextParser
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline

from ...interface.status import Status
from ..files import save_figures, scenario_mark
from ..palette import COMPONENTS, INK
from ..style import COLOURS, label_axes, norm_of
from .axes import (
    LOOKS,
    MANY_VALUES,
    add_colour_bar,
    edges_of,
    hatching,
    make_room,
    mark_failures,
    names_of,
    outcomes,
    set_scale,
    study_axes,
    write_heading,
)
from .matrix import MOST_VARIABLES, sweep_matrix
from .rows import (
    Labels,
    PictureError,
    Rows,
    fix_axes,
    histories_of,
    label_of,
    list_attribute,
    number_label,
    parse_result,
    plain,
    result_names,
    rows_of,
    sample,
    standard_results,
    values_of,
)

if TYPE_CHECKING:
    import xarray

_formulas = MathTextParser("path")
SLICE_SIZE, MAP, FAN = (5.2, 3.6), (5.4, 4.2), (5.6, 4.0)  # inches
MOST_DRAWN, MOST_DOTS = 20_000, 20_000  # rows of a slice, and dots of a map
MOST_DOTTED = 60  # points of a curve with a dot at each
MOST_CURVES, MOST_PATHS = 6, 200  # of a slice, and of a fan
MOST_CELLS = 500  # to each side of a map


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
    """Draws a result of a study against one of its numbers; rows that failed are marked by their status on the lower
    edge.

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
    rows, notes = fix_axes(rows, _free(rows, against, by), at, labels)
    if by is not None:  # a few points of its axis, equally spaced
        along = rows.indices[:, rows.axis_of(by)]
        points = np.unique(along)
        places = np.linspace(0, len(points) - 1, min(len(points), MOST_CURVES)).round().astype(int)
        rows = rows.choose(np.isin(along, points[places]))
    outcome = outcomes(rows.status, values_of(rows, result))
    names, (drawn, left_out) = names_of(outcome), sample(rows, MOST_DRAWN)
    rows, outcome = rows.choose(drawn), outcome[drawn]
    numbers, values = rows.number(against), np.where(outcome == Status.SUCCESS, values_of(rows, result), np.nan)
    ax, keys = study_axes(rows.data, ax, SLICE_SIZE), []
    # Dots if a curve has few points, or if no line joins them.
    few, scattered = len(np.unique(rows.number(against))) <= MOST_DOTTED, rows.is_scattered(against)
    look: dict[str, Any] = {"linestyle": "none" if scattered else "-", "marker": "o" if few or scattered else ""}
    look |= {"markersize": 3.5 if few else 1.5, "rasterized": not few}
    for label, which, colour in _curves(rows, by, labels):
        order = which[np.argsort(numbers[which], kind="stable")]
        lines = ax.plot(numbers[order], values[order], color=colour, linewidth=1.2, label=label or None, **look)
        keys += lines if label else []
    set_scale(ax.xaxis, rows.is_logarithmic(against), numbers)
    make_room(ax, names)
    keys += mark_failures(ax, numbers, None, outcome, names)
    label_axes(ax, number_label(against, labels, data=data), label_of(data, result, labels))
    write_heading(ax, notes + left_out, keys)
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


def _curves(rows: Rows, by: str | None, labels: Labels) -> Iterator[tuple[str, np.ndarray, str]]:
    """Yields the label of each curve, the indices of its rows, and its colour."""
    if by is None:
        yield "", np.arange(len(rows)), COMPONENTS[0]
        return
    numbers = rows.number(by)
    points = np.unique(numbers)
    for number, colour in zip(points, colormaps[COLOURS](np.linspace(0.0, 0.85, len(points))), strict=True):
        label = f"{number_label(by, labels, with_unit=False)} = {number:.4g}"
        yield label, np.flatnonzero(numbers == number), to_hex(colour)


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
    """Draws a result of a study in colours over two of its numbers; rows that failed are hatched by their status.

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
    rows, notes = fix_axes(rows, {rows.axis_of(right), rows.axis_of(up)}, at, labels)
    crossed = rows.axis_of(right) != rows.axis_of(up) and not (rows.is_scattered(right) or rows.is_scattered(up))
    ax = study_axes(rows.data, ax, MAP)
    shown, keys, more = (_cells if crossed else _dots)(ax, rows, result, right, up)
    for axis, path in ((ax.xaxis, right), (ax.yaxis, up)):
        set_scale(axis, rows.is_logarithmic(path), rows.number(path))
    add_colour_bar(ax, shown, label_of(data, result, labels))
    label_axes(ax, number_label(right, labels, data=data), number_label(up, labels, data=data))
    write_heading(ax, notes + more, keys, most=2)
    return ax


def _cells(ax: Axes, rows: Rows, result: str, right: str, up: str) -> tuple[Any, list[Any], list[str]]:
    names, size = names_of(outcomes(rows.status, values_of(rows, result))), len(rows)
    for path in (right, up):  # every k-th point, so that there are at most MOST_CELLS
        along = rows.indices[:, rows.axis_of(path)]
        # The rounded-up quotient: never more than the most.
        rows = rows.choose(along % -(-(np.max(along) + 1) // MOST_CELLS) == 0)
    notes = [] if len(rows) == size else [f"{len(rows):,} of {size:,} rows drawn"]
    (columns, x), (lines, y) = _order_rows(rows, right), _order_rows(rows, up)
    values = values_of(rows, result)
    outcome = outcomes(rows.status, values)
    good = outcome == Status.SUCCESS
    grid = np.full((len(y), len(x)), np.nan)
    grid[lines[good], columns[good]] = values[good]
    edges = edges_of(x, rows.is_logarithmic(right)), edges_of(y, rows.is_logarithmic(up))
    shown = ax.pcolormesh(*edges, grid, cmap=COLOURS, norm=norm_of(values[good]), rasterized=True)
    for code in names:
        # Not add_patch, which would visit all corners to find limits that the mesh has already set.
        ax.add_artist(_hatch_cells(code, columns[outcome == code], lines[outcome == code], *edges))
    return shown, [Patch(**hatching(code), label=name) for code, name in names.items()], notes


def _order_rows(rows: Rows, path: str) -> tuple[np.ndarray, Float[np.ndarray, " points"]]:
    """Returns the index of each row among the sorted values at ``path``, and these values.

    Points without a computed row have values between those of their neighbours, so that their cells stay empty.
    """
    along, numbers = rows.indices[:, rows.axis_of(path)], rows.number(path)
    indices, first = np.unique(along, return_index=True)
    steps = np.diff(numbers[first])
    # Numbers that repeat, or go up and down, have no order of points; cells are those of the different values.
    if not (np.all(steps > 0) or np.all(steps < 0)):
        values, places = np.unique(numbers, return_inverse=True)
        return places, values
    # With every k-th point drawn, steps between indices are multiples of k.
    step = np.gcd.reduce(np.diff(indices)) if len(indices) > 1 else 1
    points = np.arange(indices[0], indices[-1] + 1, step)
    if rows.is_logarithmic(path) and np.min(numbers) > 0:
        values = np.exp(np.interp(points, indices, np.log(numbers[first])))
    else:
        values = np.interp(points, indices, numbers[first])
    return (along - indices[0]) // step, values


def _hatch_cells(code: int, columns: np.ndarray, lines: np.ndarray, x: np.ndarray, y: np.ndarray) -> PathPatch:
    """Hatches all cells with one status, as one patch."""
    corners = [(columns, lines), (columns + 1, lines), (columns + 1, lines + 1), (columns, lines + 1), (columns, lines)]
    points = np.stack([np.stack([x[column], y[line]], axis=-1) for column, line in corners], axis=1)
    codes = np.tile([Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY], len(points))
    return PathPatch(Outline(points.reshape(-1, 2), codes), **hatching(code), rasterized=True)


def _dots(ax: Axes, rows: Rows, result: str, right: str, up: str) -> tuple[Any, list[Any], list[str]]:
    names, (drawn, notes) = names_of(outcomes(rows.status, values_of(rows, result))), sample(rows, MOST_DOTS)
    rows = rows.choose(drawn)
    x, y, values = rows.number(right), rows.number(up), values_of(rows, result)
    outcome = outcomes(rows.status, values)
    good = outcome == Status.SUCCESS
    look = {"s": 14.0 if len(rows) <= MANY_VALUES else 4.0, "cmap": COLOURS, "norm": norm_of(values[good])}
    shown = ax.scatter(x[good], y[good], c=values[good], **look, linewidths=0.0, rasterized=True)
    return shown, mark_failures(ax, x, y, outcome, names), notes


def sweep_fan(
    data: "xarray.Dataset",
    by: str,
    ax: Axes | None = None,
    *,
    result: str | None = None,
    at: Mapping[str, float] | None = None,
    labels: Labels = None,
) -> Axes:
    """Draws the trajectories of a study with ``save = "times"``, coloured by one of its numbers.

    The figure shows the path of a ball's centre in the plane, z of a disk over time, or ``result`` over time. A row
    that failed is drawn up to the time that it reached, in the colour of its status, with a mark at its end; rows that
    did not start are counted in the legend. A ring marks the start of paths in the plane.

    **Arguments:**

    - ``data``, ``ax``, ``at``, ``labels``: as in :func:`sweep_slice`.
    - ``by``: the path of the number that gives the colours.
    - ``result``: such as ``"Omega[1]"``.

    **Raises:** as :func:`sweep_slice`, and :class:`PictureError` where states were saved only at the end.
    """
    rows = rows_of(data)
    rows, notes = fix_axes(rows, {rows.axis_of(by)}, at, labels)
    names, (drawn, left_out) = names_of(rows.status), sample(rows, MOST_PATHS)
    rows, ax = rows.choose(drawn), study_axes(rows.data, ax, FAN)
    in_plane = result is None and {"z[0]", "z[1]"} <= set(result_names(data))
    at_all_times = (name for name in result_names(data) if "save" in data[parse_result(data, name)[0]].dims)
    results = ["z[0]", "z[1]"] if in_plane else [result or next(at_all_times, result_names(data)[0])]
    curves, numbers = _paths(rows, results), rows.number(by)
    shown = ScalarMappable(norm_of(numbers, rows.is_logarithmic(by)), COLOURS)
    shown.set_array(numbers)
    colours = shown.to_rgba(numbers)
    for code in names:
        colours[rows.status == code] = to_rgba(LOOKS[code].colour)
    order = np.argsort(rows.failed, kind="stable")  # failed ones above the others
    ax.add_collection(LineCollection(list(curves[order]), colors=colours[order], linewidths=0.9))
    ends = np.stack([_end(curve) for curve in curves])
    keys = mark_failures(ax, ends[:, 0], ends[:, 1], rows.status, names)
    if in_plane:
        starts = np.unique(curves[:, 0], axis=0)
        keys += ax.plot(*starts.T, "o", ms=4.5, mew=1.0, color=INK, markerfacecolor="white", ls="none", label="start")
        ax.set_aspect("equal", adjustable="datalim")
    ax.autoscale_view()
    names_shown = [label_of(data, name, labels, at_the_end=False) for name in results]
    label_axes(ax, *(names_shown if in_plane else ["$t$", *names_shown]))
    add_colour_bar(ax, shown, number_label(by, labels, data=data))
    write_heading(ax, notes + left_out, keys, most=2)
    return ax


def _paths(rows: Rows, results: list[str]) -> Float[np.ndarray, "rows saves 2"]:
    """Returns the points of each row's curve, of one result over time or of two; NaN after the time that the row
    reached.
    """
    histories = [histories_of(rows, name) for name in results]
    times = rows.data["time"].isel(row=rows.places).values
    curves = np.stack(histories if len(histories) == 2 else [times, *histories], axis=-1)
    # A failed row may have numbers beyond the time that it reached, which mean nothing.
    late = rows.failed[:, None] & ~(times <= rows.data["reached"].values[rows.places][:, None])
    return np.where(late[:, :, None], np.nan, curves)


def _end(curve: Float[np.ndarray, "saves 2"]) -> Float[np.ndarray, " 2"]:
    """Returns the last point of a curve, NaN where it has none."""
    finite = np.flatnonzero(np.all(np.isfinite(curve), axis=1))
    return curve[finite[-1]] if finite.size else np.full(2, np.nan)


MOST_NUMBERS_DRAWN = 4


def sweep_figures(
    data: "xarray.Dataset",
    folder: str | Path,
    results: Sequence[str] = (),
    against: Sequence[str] = (),
    *,
    formats: Sequence[str] = ("png",),
    labels: Mapping[str, str] | None = None,
    svg_text: bool = False,
    replace: bool = False,
) -> list[Path]:
    """Writes figures of a study to ``folder``, and returns their paths.

    They are slices along each number of crossed axes, maps over two numbers, trajectories where states were saved at
    all times, and all numbers and results against one another. A file is named after the figure, the result and the
    paths, without brackets, as in ``slice_z0_body.mass.png``. Figures of the same study are replaced, even if it has
    more rows by now; those of another are not.

    **Arguments:**

    - ``data``: from ``xarray.open_zarr`` of a store.
    - ``results``: their names; by default those that the study's key ``find`` lists, or else the friction needed and
      the final position where they exist, and the steps.
    - ``against``: the paths of the numbers; by default the first four that vary, with
      maps only over the first two.
    - ``formats``: png, pdf or svg.
    - ``labels``: labels of paths and results on axes; by default the paper's symbols, with units.
    - ``svg_text``: whether SVG keeps text as text instead of outlines.
    - ``replace``: whether to replace files that are not figures of this study.

    **Raises:** :class:`PictureError` when nothing can be drawn, and for an unknown result or path, listing the known
    ones; nothing is written then. ``OutputError`` when a file cannot be written, and when an existing one is not a
    figure of this study.
    """
    rows = rows_of(data)
    # Wrong names are found before anything is drawn.
    for name in results:
        parse_result(data, name)
    for path in against:
        rows.axis_of(path)
    for name, label in (labels or {}).items():
        if name not in rows.paths:
            parse_result(data, name)
        _require_readable(name, label)
    rows.data.drop_vars([name for name in data.variables if "save" in data[name].dims]).load()  # once for all figures
    numbers = list(against) or (rows.varying() or list(rows.paths))[:MOST_NUMBERS_DRAWN]
    pairs = list(itertools.combinations(numbers, 2))
    chosen = list(results) or standard_results(data)
    drawings = [
        ("_".join([kind, *map(plain, words)]), draw)
        for kind, words, draw in _drawings(rows, chosen, numbers, pairs if against else pairs[:1], labels)
    ]
    # Of a study, its scenario and what it changes.
    mark = scenario_mark(
        repr([data.attrs.get("scenario", ""), *(list_attribute(data, name) for name in ("shape", "paths"))])
    )
    return save_figures(drawings, folder, mark, formats, svg_text=svg_text, replace=replace)


def _require_readable(name: str, label: str) -> None:
    """Raises a :class:`PictureError` for a label with a formula that matplotlib does not read."""
    if label.replace(r"\$", "").count("$") % 2:  # then matplotlib writes it as it is
        return
    try:
        _formulas.parse(label)
    except ValueError as error:
        reason = str(error).strip().splitlines()[-1].partition(": ")[2]
        raise PictureError(f"Label of `{name}` must be text, with formulas between $ and $, but {reason}.") from None


def _drawings(
    rows: Rows, results: list[str], numbers: list[str], pairs: list[tuple[str, str]], labels: Mapping[str, str] | None
) -> Iterator[tuple[str, tuple[str, ...], Callable[[], Any]]]:
    """Yields the kind of each figure, what it shows, and the function that draws it."""
    data = rows.data
    for result, number in itertools.product(results, numbers):
        if not rows.is_scattered(number) or len(numbers) == 1:
            by = _few_curves(rows, number, numbers)
            yield "slice", (result, number), partial(sweep_slice, data, result, number, by=by, labels=labels)
    for result, pair in itertools.product(results, pairs):
        if rows.axis_of(pair[0]) != rows.axis_of(pair[1]) or rows.is_scattered(pair[0]):
            yield "map", (result, *pair), partial(sweep_map, data, result, *pair, labels=labels)
    if any("save" in data[parse_result(data, name)[0]].dims for name in result_names(data)):
        for number in numbers:
            yield "fan", (number,), partial(sweep_fan, data, number, labels=labels)
    # As many results as there is room for beside the numbers.
    fitting = results[: MOST_VARIABLES - len(numbers)]
    if len(numbers) >= 2 and fitting:
        yield "matrix", (), partial(sweep_matrix, data, fitting, numbers, labels=labels)


def _few_curves(rows: Rows, number: str, numbers: Sequence[str]) -> str | None:
    """Returns the path of another axis with few enough points for a curve each, if there is one."""
    for path in numbers:
        axis = rows.axis_of(path)
        if axis != rows.axis_of(number) and len(np.unique(rows.indices[:, axis])) <= MOST_CURVES:
            return path
    return None
