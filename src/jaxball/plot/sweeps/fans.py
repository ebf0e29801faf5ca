"""The trajectories of a study, coloured by one of its numbers."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba

from ..palette import INK
from ..style import named
from .axes import COLOURS, coloured, heading, norm_of, study_axes
from .failures import LOOKS, marks, names_of
from .results import histories_of, label_of, parsed, result_names
from .rows import Rows, at_fixed, rows_of, sample
from .symbols import Labels, number_label

if TYPE_CHECKING:
    import xarray

SIZE = (5.6, 4.0)
MOST_CURVES = 200


def sweep_fan(
    data: "xarray.Dataset",
    by: str,
    ax: Axes | None = None,
    *,
    result: str | None = None,
    at: Mapping[str, float] | None = None,
    labels: Labels = None,
) -> Axes:
    """The trajectories of a study with ``save = "times"``, coloured by one of its numbers.

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
    rows, notes = at_fixed(rows, {rows.axis_of(by)}, at, labels)
    names, (drawn, left_out) = names_of(rows.status), sample(rows, MOST_CURVES)
    rows, ax = rows.chosen(drawn), study_axes(rows.data, ax, SIZE)
    in_plane = result is None and {"z[0]", "z[1]"} <= set(result_names(data))
    results = ["z[0]", "z[1]"] if in_plane else [result or _standard(data)]
    curves, numbers = _curves(rows, results), rows.number(by)
    shown = ScalarMappable(norm_of(numbers, rows.is_logarithmic(by)), COLOURS)
    shown.set_array(numbers)
    colours = shown.to_rgba(numbers)
    for code in names:
        colours[rows.status == code] = to_rgba(LOOKS[code].colour)
    order = np.argsort(rows.failed, kind="stable")  # failed ones above the others
    ax.add_collection(LineCollection(list(curves[order]), colors=colours[order], linewidths=0.9))
    ends = np.stack([_end(curve) for curve in curves])
    keys = marks(ax, ends[:, 0], ends[:, 1], rows.status, names)
    if in_plane:
        starts = np.unique(curves[:, 0], axis=0)
        keys += ax.plot(*starts.T, "o", ms=4.5, mew=1.0, color=INK, markerfacecolor="white", ls="none", label="start")
        ax.set_aspect("equal", adjustable="datalim")
    ax.autoscale_view()
    names_shown = [label_of(data, name, labels, at_the_end=False) for name in results]
    named(ax, *(names_shown if in_plane else ["$t$", *names_shown]))
    coloured(ax, shown, number_label(by, labels))
    heading(ax, notes + left_out, keys, most=2)
    return ax


def _curves(rows: Rows, results: list[str]) -> Float[np.ndarray, "rows saves 2"]:
    """The points of each row's curve, of one result over time or of two; NaN after the time that the row reached."""
    histories = [histories_of(rows, name) for name in results]
    times = rows.data["time"].isel(row=rows.places).values
    curves = np.stack(histories if len(histories) == 2 else [times, *histories], axis=-1)
    late = rows.failed[:, None] & ~(times <= rows.data["reached"].values[rows.places][:, None])
    return np.where(late[:, :, None], np.nan, curves)


def _standard(data: "xarray.Dataset") -> str:
    """The first result that was saved at all times, or the first of all if there is none."""
    names = result_names(data)
    return next((name for name in names if "save" in data[parsed(data, name)[0]].dims), names[0])


def _end(curve: Float[np.ndarray, "saves 2"]) -> Float[np.ndarray, " 2"]:
    """The last point of a curve, NaN where it has none."""
    finite = np.flatnonzero(np.all(np.isfinite(curve), axis=1))
    return curve[finite[-1]] if finite.size else np.full(2, np.nan)
