"""The residuals of the laws along a run."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from .palette import DASHED, FAINT, INK, mass_look
from .style import legend_above, linestyle, named, plane_axes

LEAST = 1e-8  # of the expected residual: smaller ones are drawn here
ROW = 4  # entries in a row of the legend


def law_residuals(
    times: Float[np.ndarray, " n"], residuals: Mapping[str, Float[np.ndarray, " n"]], ax: Axes | None = None
) -> Axes:
    """How far a run departs from each law over time, on a logarithmic axis.

    The residuals are multiples of those that the tolerances explain, so that a law holds as long as its curve is below
    the dashed line at 1.

    **Arguments:**

    - ``times``: the ends of the steps, ``times`` of the report of :func:`jaxball.verify.verify`.
    - ``residuals``: those of each law by its name, ``residuals`` of the report.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax)
    for k, (law, values) in enumerate(residuals.items()):
        colour, dashes = mass_look(k + 1)
        name, values = law.replace("_", " "), np.maximum(values, LEAST)
        ax.semilogy(times, values, color=colour, linestyle=linestyle(dashes), linewidth=0.9, label=name)
    ax.axhline(1.0, color=INK, linestyle=linestyle(DASHED), linewidth=0.8)
    ax.margins(x=0)
    ax.grid(axis="y", color=FAINT, linewidth=0.4)
    named(ax, "$t$", "residual / expected")
    legend_above(ax, ROW)
    return ax
