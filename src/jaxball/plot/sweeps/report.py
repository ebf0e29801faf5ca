"""The figures that suit a study, written into a folder."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import save_figures, scenario_mark
from .figures import MOST_CURVES, sweep_fan, sweep_map, sweep_slice
from .matrix import MOST_VARIABLES, sweep_matrix
from .rows import Rows, list_attribute, parse_result, plain, result_names, rows_of, standard_results

if TYPE_CHECKING:
    import xarray

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
    for name in labels or {}:
        if name not in rows.paths:
            parse_result(data, name)
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
