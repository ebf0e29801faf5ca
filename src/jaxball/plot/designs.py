"""Figures of designs: the path that was wanted, the rails' motion, and how the search went."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Circle as Ring
from matplotlib.ticker import MaxNLocator

from .style import (
    COMPONENTS,
    DASHED,
    INK,
    SHELL,
    TRAIL,
    WIDE,
    ends,
    legend_above,
    mass_line,
    named,
    number_decades,
    plane_axes,
    up_to_ticks,
)


def designed_path(
    before: Float[np.ndarray, "t 2"],
    after: Float[np.ndarray, "t 2"],
    wanted: Float[np.ndarray, "k 2"] | None = None,
    discs: Sequence[tuple[Float[np.ndarray, "2"], float]] = (),
    ax: Axes | None = None,
) -> Axes:
    """The path of the geometric centre before and after, the wanted one dashed, and the discs to stay out of.

    A ring is the start of the path after, a square its end.

    **Arguments:**

    - ``before``, ``after``: places at times, length, shape (t, 2).
    - ``wanted``: points of the wanted path, shape (k, 2), or None.
    - ``discs``: centre and radius of each.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, (WIDE[0], 4.0))
    for centre, radius in discs:
        ax.add_patch(Ring((float(centre[0]), float(centre[1])), radius, facecolor="0.9", edgecolor=SHELL))
    ax.plot(*before.T, color="0.7", linewidth=1.0, label="before")
    ax.plot(*after.T, color=TRAIL, linewidth=1.4, label="after")
    if wanted is not None:
        ax.plot(*wanted.T, color=INK, linewidth=0.8, linestyle=DASHED, label="wanted")
    ends(ax, after, TRAIL, labelled=True, zorder=3)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.08)
    named(ax, "$z_1$", "$z_2$")
    legend_above(ax)
    return ax


def rail_angles(times: Float[np.ndarray, " t"], theta: Float[np.ndarray, "t n"], ax: Axes | None = None) -> Axes:
    """θ_i over time.

    **Arguments:**

    - ``times``: shape (t,).
    - ``theta``: θ of each mass then, shape (t, n).

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    return _of_masses(times, theta, r"\theta", ax)


def rail_accelerations(times: Float[np.ndarray, " t"], u: Float[np.ndarray, "t n"], ax: Axes | None = None) -> Axes:
    """θ̈_i over time.

    **Arguments:**

    - ``times``: shape (t,).
    - ``u``: θ̈ of each mass then, shape (t, n).

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    return _of_masses(times, u, r"\ddot\theta", ax)


def _of_masses(times: np.ndarray, values: np.ndarray, symbol: str, ax: Axes | None) -> Axes:
    ax = plane_axes(ax)
    for i in range(values.shape[1]):
        ax.plot(times, values[:, i], label=f"${symbol}_{{{i + 1}}}$", **mass_line(i + 1))
    ax.margins(x=0)
    up_to_ticks(ax)
    named(ax, "$t$", f"${symbol}_i$")
    legend_above(ax)
    return ax


def convergence(
    objective: Float[np.ndarray, " k"],
    violation: Float[np.ndarray, " k"],
    gradient: Float[np.ndarray, " k"],
    ax: Axes | None = None,
    *,
    polish: int | None = None,
) -> Axes:
    """Objective, violation and gradient norm of the best start at each report, on a logarithmic scale.

    Triangles on the lower edge are reports at which no constraint was violated; other numbers that are not positive are
    left out. ``polish`` is the report with which the polish begins, where a line is drawn.

    **Arguments:**

    - ``objective``, ``violation``, ``gradient``: one entry for each report, shape (k,).

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax)
    rows = zip(("objective", "violation", "gradient"), (objective, violation, gradient), COMPONENTS, strict=True)
    for name, values, colour in rows:
        ax.plot(np.where(values > 0, values, np.nan), color=colour, linewidth=1.2, label=name, marker=".", ms=5)
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    number_decades(ax.yaxis, high / low)
    held = np.flatnonzero(violation <= 0)
    if held.size:
        edge = {"transform": ax.get_xaxis_transform(), "clip_on": False, "linestyle": "none"}
        mark = {"marker": "v", "ms": 5, "mew": 1.0, "color": COMPONENTS[1], "markerfacecolor": "white"}
        ax.plot(held, np.zeros(held.size), label="none violated", **edge, **mark)
    if polish is not None:
        ax.axvline(polish - 0.5, color=SHELL, linewidth=0.8, label="polish begins")
    ax.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10], integer=True))
    named(ax, "report of the search", "objective, violation,\nnorm of the gradient")
    legend_above(ax, most=3)
    return ax
