"""The figure of all numbers and results of a study against one another, a panel for each pair."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import blended_transform_factory

from ...interface.status import Status
from ...interface.wording import number_of
from ..palette import COMPONENTS
from ..style import SMALL_FONT, ShownFigure, label_axes, number, plane_axes
from .axes import (
    LOOKS,
    MANY_VALUES,
    caption_of_study,
    edges_of,
    make_room,
    mark_failures,
    names_of,
    outcomes,
    present,
    set_scale,
)
from .rows import (
    Labels,
    PictureError,
    Rows,
    label_of,
    number_label,
    rows_of,
    sample,
    standard_results,
    tolerance_of,
    values_of,
)

if TYPE_CHECKING:
    import xarray

MATRIX_PANEL = 1.75
MOST_DOTS = 5_000
MOST_VARIABLES = 8
MOST_LETTERS = 18
LONG_NUMBERS = 4  # as many digits before the point, or zeros after it, are written as a power of ten
_BINS = 20
_MOST_POINTS = 100_000


class _Variable(NamedTuple):
    label: str
    values: np.ndarray
    is_number: bool = False
    logarithmic: bool = False
    crossed: bool = False  # one of the numbers of a crossed axis


def sweep_matrix(
    data: "xarray.Dataset",
    results: Sequence[str] | None = None,
    numbers: Sequence[str] | None = None,
    *,
    labels: Labels = None,
) -> Figure:
    """Draws a panel for each pair of the numbers that a study changes and of some results.

    Rows that failed are marked by their status: at their position among numbers, on the lower edge under a result. The
    histograms on the diagonal count the rows that succeeded, and stacked on them those that failed; of a number of a
    crossed axis, whose points have equally many rows, they count those that failed alone. A result that the tolerance
    of the solves does not tell from 0 in any row is drawn as 0, and its label says so.

    **Arguments:**

    - ``data``: from ``xarray.open_zarr`` of a store.
    - ``results``: as in :func:`sweep_slice`; by default a few important ones.
    - ``numbers``: paths; by default those of all numbers that vary.
    - ``labels``: as in :func:`sweep_slice`.

    **Raises:** as :func:`sweep_slice`, and :class:`PictureError` for more than eight numbers and results together.
    """
    rows = rows_of(data)
    results = standard_results(data) if results is None else results
    numbers = rows.varying() if numbers is None else numbers
    if not 2 <= len(numbers) + len(results) <= MOST_VARIABLES:
        raise PictureError(
            f"Arguments `results` and `numbers` must be 2 to {MOST_VARIABLES} together, but they are "
            f"{len(results)} and {len(numbers)}; choose some of {', '.join([*results, *numbers])}."
        )
    variables = []
    for path in numbers:
        logarithmic, crossed = rows.is_logarithmic(path), not rows.is_scattered(path)
        label = _wrap_path(number_label(path, labels, data=data))
        variables.append(_Variable(label, rows.number(path), True, logarithmic, crossed))
    variables += [_result(rows, name, labels) for name in results]
    variables = [_in_powers_of_ten(variable) for variable in variables]
    n, keys, panels = len(variables), {}, {}
    drawn, left_out = sample(rows, MOST_DOTS)
    figure = ShownFigure(figsize=(MATRIX_PANEL * n + 0.6, MATRIX_PANEL * n + 0.6), layout="constrained")
    caption_of_study(figure, rows.data)
    for i, up in enumerate(variables):
        for j, right in enumerate(variables[: i + 1]):
            left = panels.get((i, 0)) if i != j else None
            ax = plane_axes(figure.add_subplot(n, n, i * n + j + 1, sharex=panels.get((j, j)), sharey=left))
            panels[i, j] = ax
            for axis in (ax.xaxis, ax.yaxis):
                axis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
            if i == j:
                _counts(ax, rows, up)
            else:
                keys |= _panel(ax, rows, drawn, right, up, first=j == 0)
            label_axes(ax, right.label if i == n - 1 else "", up.label if j == 0 and i else "")
            ax.tick_params(labelbottom=i == n - 1, labelleft=j == 0 and i > 0)
    figure.legend(
        handles=list(keys.values()),
        title=left_out[0] if left_out else number_of(len(rows), "row"),
        loc="upper right",
        # In the empty corner, and not over a caption of several lines.
        bbox_to_anchor=(1.0, 1.0),
        bbox_transform=blended_transform_factory(figure.transFigure, panels[0, 0].transAxes),
        frameon=False,
        prop=SMALL_FONT,
        title_fontproperties=SMALL_FONT,
    )
    return figure


def _panel(ax: Axes, rows: Rows, drawn: np.ndarray, right: _Variable, up: _Variable, first: bool) -> dict[str, Any]:
    """Draws one variable against another, and returns the legend keys of the failures by their labels."""
    outcome = rows.status if up.is_number else outcomes(rows.status, up.values)
    names, outcome = names_of(outcome), outcome[drawn]
    good = drawn[outcome == Status.SUCCESS]
    size = 2.5 if len(drawn) <= MANY_VALUES else 1.2
    ax.plot(right.values[good], up.values[good], "o", ms=size, mew=0.0, color=COMPONENTS[0], ls="none", rasterized=True)
    set_scale(ax.xaxis, right.logarithmic, right.values)
    set_scale(ax.yaxis, up.logarithmic, up.values)
    if first and right.is_number and not up.is_number:
        make_room(ax, names)
    if not right.is_number:
        return {}
    above = up.values[drawn] if up.is_number else None
    lines = mark_failures(ax, right.values[drawn], above, outcome, names, size=3.5)
    return {str(line.get_label()): line for line in lines}


def _counts(ax: Axes, rows: Rows, variable: _Variable) -> None:
    """Draws a histogram; the one for a number has the rows that failed stacked on the others."""
    values = variable.values[np.isfinite(variable.values)]
    if not values.size:
        return
    edges = _edges(np.unique(values), variable)
    below = np.zeros(len(edges) - 1)
    # Of a crossed axis each point has as many rows as the others, and a constant has one bar: both would be squares.
    constant = values.min() == values.max()
    succeeded = [] if constant or (variable.is_number and variable.crossed) else [Status.SUCCESS]
    for code in [*succeeded, *(present(rows.status) if variable.is_number else ())]:
        these = variable.values[(rows.status == code) & np.isfinite(variable.values)]
        above = below + np.histogram(these, edges)[0]
        colour = COMPONENTS[0] if code == Status.SUCCESS else LOOKS[code].colour
        ax.stairs(above, edges, baseline=below, fill=True, color=colour)
        below = above
    ax.spines["left"].set_visible(False)
    ax.tick_params(left=False)
    if not succeeded:
        ax.set_xlim(edges[0], edges[-1])  # also where no row failed
    set_scale(ax.xaxis, variable.logarithmic, values)


def _edges(different: Float[np.ndarray, " values"], variable: _Variable) -> Float[np.ndarray, " edges"]:
    """Returns the edges of the bars.

    There is one bar for each point of a crossed axis. Where the values lie on another grid, such as the whole numbers,
    all bars hold equally many of its points; otherwise the bars are equally wide.
    """
    if variable.crossed or len(different) == 1:
        return edges_of(different, variable.logarithmic)
    logarithmic = variable.logarithmic and different[0] > 0
    places = np.log(different) if logarithmic else different
    step = np.min(np.diff(places))
    points = (places - places[0]) / step
    if points[-1] < _MOST_POINTS and np.allclose(points, np.round(points), rtol=0.0, atol=1e-3):
        each = math.ceil((points[-1] + 1) / _BINS)
        edges = places[0] + step * (each * np.arange(math.ceil((points[-1] + 1) / each) + 1) - 0.5)
    else:
        edges = np.linspace(places[0], places[-1], _BINS + 1)
    return np.exp(edges) if logarithmic else edges


def _result(rows: Rows, name: str, labels: Labels) -> _Variable:
    """Returns a result, as 0 where it is no more than the tolerance in all rows."""
    label, values, tolerance = label_of(rows.data, name, labels), values_of(rows, name), tolerance_of(rows.data)
    largest = np.max(np.abs(values), initial=0.0, where=np.isfinite(values))
    if not 0 < largest <= tolerance:
        return _Variable(label, values)
    return _Variable(f"{label}\n0 to within ${number(tolerance)}$", np.where(np.isfinite(values), 0.0, values))


def _in_powers_of_ten(variable: _Variable) -> _Variable:
    """Returns a variable in a power of ten that its label names, where matplotlib would write it over the label."""
    largest = np.max(np.abs(variable.values), initial=0.0, where=np.isfinite(variable.values))
    power = math.floor(math.log10(largest)) if largest > 0 else 0
    if variable.logarithmic or -LONG_NUMBERS < power < LONG_NUMBERS:
        return variable
    return variable._replace(label=f"{variable.label}\nin $10^{{{power}}}$", values=variable.values * 10.0**-power)


def _wrap_path(path: str) -> str:
    """Writes a long path on two lines."""
    if "$" in path:
        return path
    head, _, tail = path.rpartition(".")
    return path if len(path) <= MOST_LETTERS or not head else f"{head}\n.{tail}"
