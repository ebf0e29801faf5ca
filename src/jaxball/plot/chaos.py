"""Charts of the largest Lyapunov exponent."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from ..chaos import LyapunovSpectrum
from .style import SMALL, colour_bar, legend_above, mass_line, named, plane_axes

if TYPE_CHECKING:
    import xarray

CHART = (5.2, 4.0)
LIFTED, FAILED = "0.82", "#BB5566"


def chaos_chart(dataset: "xarray.Dataset", ax: Axes | None = None, *, largest: float | None = None) -> Axes:
    """The data set of :func:`jaxball.chaos.chart` in colours, the first parameter upwards.

    Grey marks where the ball would leave the plane, red where the solve failed.

    **Arguments:**

    - ``dataset``: what :func:`jaxball.chaos.chart` returns.
    - ``largest``: the exponent at the end of the colours; if not given, the largest on the chart. The colours begin
      at zero, and smaller exponents have the colour of zero.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, CHART)
    up, right = (dataset[name].values for name in dataset["exponent"].dims)
    exponent = dataset["exponent"].values
    failed = dataset["status"].values != 0
    lifted = ~failed & (dataset["least_normal_force"].values <= 0)
    known = exponent[np.isfinite(exponent)]
    top = largest if largest is not None else max(float(known.max(initial=0.0)), 1e-12)
    mesh = ax.pcolormesh(right, up, exponent, cmap="magma_r", vmin=0.0, vmax=top, rasterized=True)
    keys = []
    for where, colour, name in ((lifted, LIFTED, "leaves the plane"), (failed, FAILED, "solve failed")):
        if where.any():
            marked = np.where(where, 1.0, np.nan)
            ax.pcolormesh(right, up, marked, cmap=ListedColormap([colour]), rasterized=True)
            keys.append(Patch(color=colour, label=name))
    if keys:
        ax.legend(handles=keys, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, prop=SMALL)
    colour_bar(ax, mesh, r"$\lambda_1$", extend="max" if known.size and known.max() > top else "neither")
    first, second = dataset["exponent"].dims
    named(ax, str(second), str(first))
    return ax


def lyapunov_convergence(spectrum: LyapunovSpectrum, ax: Axes | None = None) -> Axes:
    """The running means of the Lyapunov exponents over time.

    **Arguments:**

    - ``spectrum``: what :func:`jaxball.chaos.lyapunov_spectrum` returns.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax)
    times, running = np.asarray(spectrum.times), np.asarray(spectrum.running)
    for i in range(running.shape[1]):
        line = mass_line(i + 1)
        ax.plot(times, running[:, i], label=rf"$\lambda_{i + 1}$", **line)
    ax.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)
    ax.margins(x=0)
    named(ax, "$t$", r"$\lambda_i$")
    legend_above(ax)
    return ax
