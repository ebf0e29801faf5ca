"""The figures that suit a study, written into a folder."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import check_others, save_figure, scenario_mark
from .figures import MOST_CURVES, sweep_fan, sweep_map, sweep_slice
from .matrix import MOST_VARIABLES, sweep_matrix
from .rows import Rows, listed, parsed, plain, result_names, rows_of, standard_results

if TYPE_CHECKING:
    import xarray

MOST_NUMBERS = 4


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
    for name in results:
        parsed(data, name)
    for path in against:
        rows.axis_of(path)
    for name in labels or {}:
        if name not in rows.paths:
            parsed(data, name)
    rows.data.drop_vars([name for name in data.variables if "save" in data[name].dims]).load()  # once for all figures
    numbers = list(against) or (rows.varying() or list(rows.paths))[:MOST_NUMBERS]
    pairs = list(itertools.combinations(numbers, 2))
    drawings = list(
        _drawings(rows, list(results) or standard_results(data), numbers, pairs if against else pairs[:1], labels)
    )
    folder, mark = Path(folder), scenario_mark(_identity(data))
    paths = [[folder / f"{'_'.join(map(plain, words))}.{suffix}" for suffix in formats] for words, _ in drawings]
    if not replace:
        check_others(itertools.chain(*paths), mark, "replace=True")
    folder.mkdir(parents=True, exist_ok=True)
    for files, (_, draw) in zip(paths, drawings, strict=True):
        drawn = draw()
        for path in files:
            save_figure(drawn, path, mark, svg_text=svg_text)
    return list(itertools.chain(*paths))


def _identity(data: "xarray.Dataset") -> str:
    """The mark of a study: its scenario, and what it changes."""
    return repr([data.attrs.get("scenario", ""), *(listed(data, name) for name in ("shape", "paths"))])


def _drawings(
    rows: Rows, results: list[str], numbers: list[str], pairs: list[tuple[str, str]], labels: Mapping[str, str] | None
) -> Iterator[tuple[list[str], Callable[[], Any]]]:
    """The parts of each file's name, and the function that draws the figure."""
    data = rows.data
    for result, number in itertools.product(results, numbers):
        if not rows.is_scattered(number) or len(numbers) == 1:
            by = _few_curves(rows, number, numbers)
            yield (
                ["slice", result, number],
                lambda r=result, n=number, b=by: sweep_slice(data, r, n, by=b, labels=labels),
            )
    for result, (first, second) in itertools.product(results, pairs):
        if rows.axis_of(first) != rows.axis_of(second) or rows.is_scattered(first):
            yield (
                ["map", result, first, second],
                lambda r=result, a=first, b=second: sweep_map(data, r, a, b, labels=labels),
            )
    if any("save" in data[parsed(data, name)[0]].dims for name in result_names(data)):
        for number in numbers:
            yield ["fan", number], lambda n=number: sweep_fan(data, n, labels=labels)
    fitting = results[: MOST_VARIABLES - len(numbers)]
    if len(numbers) >= 2 and fitting:
        yield ["matrix"], lambda: sweep_matrix(data, fitting, numbers, labels=labels)


def _few_curves(rows: Rows, number: str, numbers: Sequence[str]) -> str | None:
    """The path of another axis with few enough points for a curve each, if there is one."""
    for path in numbers:
        axis = rows.axis_of(path)
        if axis != rows.axis_of(number) and len(np.unique(rows.indices[:, axis])) <= MOST_CURVES:
            return path
    return None
