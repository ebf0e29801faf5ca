"""Numbers and results of a study against one another."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...status import Status
from ...wording import counted
from ..style import COMPONENTS, SMALL, named, plane_axes
from .errors import PictureError
from .failures import LOOKS, MANY, make_room, marks, names_of, outcomes, present
from .fixed import sample
from .heading import edges_of, scale
from .results import label_of, standard_results, values_of
from .rows import Rows, rows_of

if TYPE_CHECKING:
    import xarray

PANEL = 1.75
MOST_DOTS = 5_000
MOST_VARIABLES = 8
MOST_LETTERS = 18
MOST_BARS = 30
_BINS = 20


class _Variable(NamedTuple):
    label: str
    values: np.ndarray
    is_number: bool
    logarithmic: bool


def sweep_matrix(
    data: "xarray.Dataset", results: Sequence[str] | None = None, numbers: Sequence[str] | None = None
) -> Figure:
    """Each number that a study changes, and each of some results, against all others.

    Rows that failed have a mark by their status: at their place among numbers, on the lower edge under a result. The
    diagonal counts the rows that succeeded, and above them those that failed.

    **Arguments:**

    - ``data``: from ``xarray.open_zarr`` of a store.
    - ``results``: as in :func:`sweep_slice`; a few that say most if not given.
    - ``numbers``: paths; all that vary if not given.

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
    variables = [_Variable(_broken(path), rows.number(path), True, rows.is_logarithmic(path)) for path in numbers]
    variables += [_Variable(label_of(data, name), values_of(rows, name), False, False) for name in results]
    return _drawn(rows, variables)


def _drawn(rows: Rows, variables: Sequence[_Variable]) -> Figure:
    n, keys, panels = len(variables), {}, {}
    drawn, left_out = sample(rows, MOST_DOTS)
    figure = Figure(figsize=(PANEL * n + 0.6, PANEL * n + 0.4), layout="constrained")
    for i, up in enumerate(variables):
        for j, right in enumerate(variables[: i + 1]):
            beside = panels.get((i, 0)) if i != j else None
            ax = plane_axes(figure.add_subplot(n, n, i * n + j + 1, sharex=panels.get((j, j)), sharey=beside))
            panels[i, j] = ax
            for axis in (ax.xaxis, ax.yaxis):
                axis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
            if i == j:
                _counts(ax, rows, up)
            else:
                keys |= _panel(ax, rows, drawn, right, up, first=j == 0)
            named(ax, right.label if i == n - 1 else "", up.label if j == 0 and i else "")
            ax.tick_params(labelbottom=i == n - 1, labelleft=j == 0 and i > 0)
    entries = list(keys.values())
    figure.legend(
        handles=entries,
        title=left_out[0] if left_out else counted(len(rows), "row"),
        loc="upper right",
        frameon=False,
        prop=SMALL,
        title_fontproperties=SMALL,
    )
    return figure


def _panel(ax: Axes, rows: Rows, drawn: np.ndarray, right: _Variable, up: _Variable, first: bool) -> dict[str, Any]:
    """Draws one against another, and returns the keys of the rows that failed by their labels."""
    outcome = rows.status if up.is_number else outcomes(rows.status, up.values)
    names, outcome = names_of(outcome), outcome[drawn]
    good = drawn[outcome == Status.SUCCESS]
    ax.plot(
        right.values[good],
        up.values[good],
        "o",
        color=COMPONENTS[0],
        markersize=2.5 if len(drawn) <= MANY else 1.2,
        markeredgewidth=0.0,
        linestyle="none",
        rasterized=True,
    )
    scale(ax.xaxis, right.logarithmic, right.values)
    scale(ax.yaxis, up.logarithmic, up.values)
    if first and right.is_number and not up.is_number:
        make_room(ax, names)
    if not right.is_number:
        return {}
    above = up.values[drawn] if up.is_number else None
    lines = marks(ax, right.values[drawn], above, outcome, names, size=3.5)
    return {str(line.get_label()): line for line in lines}


def _counts(ax: Axes, rows: Rows, variable: _Variable) -> None:
    """A histogram; of a number, with the rows that failed above the others."""
    values = variable.values[np.isfinite(variable.values)]
    if not values.size:
        return
    different = np.unique(values)
    if variable.is_number and len(different) <= MOST_BARS:  # a bar for each point of a crossed axis
        edges = edges_of(different, variable.logarithmic)
    else:
        spread = np.geomspace if variable.logarithmic and different[0] > 0 else np.linspace
        ends = different[[0, -1]] if len(different) > 1 else different[0] + np.array([-0.5, 0.5])
        edges = spread(float(ends[0]), float(ends[1]), _BINS + 1)
    codes = [Status.SUCCESS, *(present(rows.status) if variable.is_number else ())]
    ax.hist(
        [variable.values[(rows.status == code) & np.isfinite(variable.values)] for code in codes],
        bins=edges.tolist(),
        stacked=True,
        color=[COMPONENTS[0] if code == Status.SUCCESS else LOOKS[code].colour for code in codes],
    )
    ax.spines["left"].set_visible(False)
    ax.tick_params(left=False)
    scale(ax.xaxis, variable.logarithmic, values)


def _broken(path: str) -> str:
    """A long path on two lines."""
    head, _, tail = path.rpartition(".")
    return path if len(path) <= MOST_LETTERS or not head else f"{head}\n.{tail}"
