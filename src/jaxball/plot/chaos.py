"""Figures of chaos and stability: Lyapunov exponents, Poincaré maps and eigenvalues."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import QuadMesh
from matplotlib.colors import ListedColormap
from matplotlib.patches import Circle, Patch

from ..analysis.chaos.result import LyapunovSpectrum
from ..analysis.stability.periodic import PeriodicMotion
from ..analysis.stability.steady import SteadyMotion
from ..simulation.variables import symbol
from .palette import COMPONENTS, INK
from .style import SMALL_FONT, SQUARE, colour_bar, label_axes, legend_above, mass_line, plane_axes, zero_line

if TYPE_CHECKING:
    import xarray

CHART = (5.2, 4.0)
LIFTED, FAILED = "0.82", "#BB5566"
STABLE = ((True, "stable", "o", COMPONENTS[0]), (False, "unstable", "x", COMPONENTS[1]))
NEUTRAL_GROWTH = 1e-6  # a growth rate of either sign below this is rounding


def chart(dataset: "xarray.Dataset", ax: Axes | None = None, *, largest: float | None = None) -> Axes:
    """Draws a chart of exponents or of growth rates in colours, its first parameter on the vertical axis.

    Of :func:`jaxball.analysis.chaos.chart`, grey marks where the ball would leave the plane, red where the solve
    failed. Of :func:`jaxball.analysis.stability.floquet_chart`, deviations grow in red regions and decay in blue ones,
    with a line between them; grey is where no periodic motion was found.

    **Arguments:**

    - ``dataset``: what either returns.
    - ``largest``: the exponent or the growth rate at the end of the colour scale, in 1/time; by default the largest
      magnitude on the chart. The scale of exponents begins at zero, and negative ones have the colour of zero.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    return (_growth_rates if "growth" in dataset else _exponents)(dataset, ax, largest)


def _exponents(dataset: "xarray.Dataset", ax: Axes | None, largest: float | None) -> Axes:
    exponent, failed = dataset["exponent"].values, dataset["status"].values != 0
    lifted = ~failed & (dataset["least_normal_force"].values <= 0)
    exponents = exponent[np.isfinite(exponent)]
    # Not 0, so that a chart without any growth has a scale.
    top = largest if largest is not None else max(float(exponents.max(initial=0.0)), 1e-12)
    marks = {"leaves the plane": (lifted, LIFTED), "solve failed": (failed, FAILED)}
    ax, mesh = _chart(dataset["exponent"], ax, marks, cmap="magma_r", vmin=0.0, vmax=top)
    colour_bar(ax, mesh, r"$\lambda_1$", extend="max" if exponents.size and exponents.max() > top else "neither")
    return ax


def _chart(
    values: "xarray.DataArray", ax: Axes | None, marks: Mapping[str, tuple[np.ndarray, str]], **look: Any
) -> tuple[Axes, QuadMesh]:
    """Draws values over two parameters in colours, the first upwards, and lists by name the cells that have a colour of
    their own.
    """
    ax, (up, right) = plane_axes(ax, CHART), map(str, values.dims)
    # As an image also in vector files, where each cell would be a shape.
    mesh = ax.pcolormesh(values[right], values[up], values, rasterized=True, **look)
    keys = []
    for name, (where, colour) in marks.items():
        if where.any():
            marked = np.where(where, 1.0, np.nan)
            ax.pcolormesh(values[right], values[up], marked, cmap=ListedColormap([colour]), rasterized=True)
            keys.append(Patch(color=colour, label=name))
    if keys:
        ax.legend(handles=keys, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False, prop=SMALL_FONT)
    label_axes(ax, right, up)
    return ax, mesh


def _growth_rates(dataset: "xarray.Dataset", ax: Axes | None, largest: float | None) -> Axes:
    growth = dataset["growth"].values
    has_motion = np.isfinite(growth)
    size = float(np.max(np.abs(growth[has_motion]), initial=0.0))
    end = largest if largest is not None else max(size, 1e-12)
    marks = {"no periodic motion found": (~has_motion, LIFTED)}
    ax, mesh = _chart(dataset["growth"], ax, marks, cmap="RdBu_r", vmin=-end, vmax=end)
    # A line needs two points along each axis, and rates on both sides.
    if min(growth.shape) > 1 and np.any(growth > NEUTRAL_GROWTH) and np.any(growth < -NEUTRAL_GROWTH):
        up, right = (dataset[name].values for name in dataset["growth"].dims)
        # Neutral motions count as neither growing nor decaying.
        signed_growth = np.where(growth > NEUTRAL_GROWTH, growth, np.minimum(growth, -NEUTRAL_GROWTH))
        ax.contour(right, up, signed_growth, levels=[0.0], colors=INK, linewidths=0.8)
    ends = (bool(size and np.min(growth[has_motion]) < -end), bool(size and np.max(growth[has_motion]) > end))
    extend = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}[ends]
    colour_bar(ax, mesh, "growth rate", extend=extend)
    return ax


def lyapunov_convergence(spectrum: LyapunovSpectrum, ax: Axes | None = None) -> Axes:
    ax = plane_axes(ax)
    times, running = np.asarray(spectrum.times), np.asarray(spectrum.running)
    for i in range(running.shape[1]):
        lost = np.isneginf(running[-1, i])  # which has no curve
        name = rf"\lambda_{i + 1} = -\infty" if lost else rf"\lambda_{i + 1}"
        ax.plot(times, np.where(lost, np.nan, running[:, i]), label=f"${name}$", **mass_line(i + 1))
    zero_line(ax)
    ax.margins(x=0)
    label_axes(ax, "$t$", r"$\lambda_i$")
    legend_above(ax)
    return ax


def poincare_section(
    across: Float[np.ndarray, " n"], up: Float[np.ndarray, " n"], names: tuple[str, str], ax: Axes | None = None
) -> Axes:
    """Draws the crossings of a section, by two components of the states there.

    **Arguments:**

    - ``across``, ``up``: the components, one entry for each crossing, shape (n,).
    - ``names``: their paths in a state, counted from 0, as in ``Omega[0]``; the labels have the paper's symbols, which
      count from 1.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, SQUARE)
    ax.plot(across, up, color=INK, marker=".", linestyle="none", ms=2.5, mew=0)
    label_axes(ax, *map(symbol, names))
    return ax


def eigenvalues(motions: Sequence[SteadyMotion] | Sequence[PeriodicMotion], ax: Axes | None = None) -> Axes:
    """Draws the eigenvalues of steady motions, or the Floquet multipliers of periodic ones, in the complex plane.

    Stable ones have one colour, unstable ones another. With multipliers there is the unit circle: deviations grow if
    one is outside it.

    **Arguments:**

    - ``motions``: what :mod:`jaxball.analysis.stability` finds, all of one kind.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, SQUARE)
    periodic = [motion for motion in motions if isinstance(motion, PeriodicMotion)]
    if not periodic:
        steady = [(motion.stable, motion.eigenvalues) for motion in motions if isinstance(motion, SteadyMotion)]
        _in_the_complex_plane(ax, steady, r"\lambda")
        return ax
    ax.add_patch(Circle((0.0, 0.0), 1.0, fill=False, color="0.75", linewidth=0.6, zorder=0))
    _in_the_complex_plane(ax, [(motion.stable, motion.multipliers) for motion in periodic if motion.ok], r"\rho")
    ax.set_aspect("equal", adjustable="datalim")
    return ax


def _in_the_complex_plane(ax: Axes, motions: Sequence[tuple[bool, np.ndarray]], letter: str) -> None:
    """Draws the numbers of each motion in the complex plane, marked by whether it is stable."""
    ax.axvline(0.0, color="0.75", linewidth=0.6, zorder=0)
    zero_line(ax)
    for stable, label, marker, colour in STABLE:
        chosen = [numbers for is_stable, numbers in motions if is_stable == stable]
        if chosen:
            values, look = np.concatenate(chosen), {"ms": 5, "linestyle": "none", "mfc": "none"}
            ax.plot(np.real(values), np.imag(values), marker, color=colour, label=label, **look)
    label_axes(ax, rf"$\mathrm{{Re}}\,{letter}$", rf"$\mathrm{{Im}}\,{letter}$")
    legend_above(ax)
