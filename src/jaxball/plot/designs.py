"""Figures of designs and optimal control: paths, the motion along the rails, the search, and branches of solutions."""

import itertools
import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Circle as Ring
from matplotlib.ticker import MaxNLocator

from .palette import COMPONENTS, DASHED, INK, MASSES, SHELL, TRAIL
from .style import (
    WIDE_FIGURE,
    Captioned,
    finish_path,
    label_axes,
    legend_above,
    linestyle,
    mark_ends,
    mass_line,
    number_decades,
    plane_axes,
    up_to_ticks,
)

COLOURS = (*COMPONENTS, INK, *MASSES)
PATH_COLOURS = ("0.6", TRAIL, *COLOURS)  # grey before and red after, as in the plane
LABEL_LETTERS = 36  # per line of the label of the vertical axis


def designed_path(
    before: Float[np.ndarray, "t 2"],
    after: Float[np.ndarray, "t 2"],
    wanted: Float[np.ndarray, "k 2"] | None = None,
    discs: Sequence[tuple[Float[np.ndarray, "2"], float]] = (),
    ax: Axes | None = None,
    *,
    names: tuple[str, str] = ("before", "after"),
    system: Captioned = None,
) -> Axes:
    """Draws the path of the geometric centre before and after, the target path dashed, and the discs to avoid.

    A ring marks the start of the path after, a square its end.

    **Arguments:**

    - ``before``, ``after``: positions over time, length, shape (t, 2).
    - ``wanted``: points of the target path, shape (k, 2), or None.
    - ``discs``: centre and radius of each.
    - ``names``: the labels of both paths.
    - ``system``: the system that the caption of a new figure names, or a run of it.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, (WIDE_FIGURE[0], 4.0), system)
    for centre, radius in discs:
        ax.add_patch(Ring((float(centre[0]), float(centre[1])), radius, facecolor="0.9", edgecolor=SHELL))
    ax.plot(*before.T, color="0.7", linewidth=1.0, label=names[0])
    ax.plot(*after.T, color=TRAIL, linewidth=1.4, label=names[1])
    if wanted is not None:
        ax.plot(*wanted.T, color=INK, linewidth=0.8, linestyle=linestyle(DASHED), label="target")
    mark_ends(ax, after, TRAIL, labelled=True, zorder=3)
    return finish_path(ax)


def place_in_time(
    paths: Mapping[str, tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]],
    wanted: tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]] | None = None,
    ax: Axes | None = None,
    *,
    system: Captioned = None,
) -> Axes:
    """Draws z of a disk over time in several cases, and its target, dashed.

    **Arguments:**

    - ``paths``: times and positions of each case, by name.
    - ``wanted``: times and positions of the target, or None.
    - ``system``: the system that the caption of a new figure names, or a run of it.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, shown=system)
    for (label, path), colour in zip(paths.items(), itertools.cycle(PATH_COLOURS), strict=False):
        ax.plot(*path, color=colour, linewidth=1.4, label=label)
    if wanted is not None:
        ax.plot(*wanted, color=INK, linewidth=0.8, linestyle=linestyle(DASHED), label="target")
    return _over_time(ax, "$z$")


def rail_angles(
    times: Float[np.ndarray, " t"], theta: Float[np.ndarray, "t n"], ax: Axes | None = None, *, system: Captioned = None
) -> Axes:
    """Draws θ_i over time.

    **Arguments:**

    - ``times``: shape (t,).
    - ``theta``: θ of each mass at each time, shape (t, n).
    - ``system``: the system that the caption of a new figure names, or a run of it.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    return _of_masses(times, theta, r"\theta", ax, system)


def rail_accelerations(
    times: Float[np.ndarray, " t"], u: Float[np.ndarray, "t n"], ax: Axes | None = None, *, system: Captioned = None
) -> Axes:
    """Draws θ̈_i over time.

    **Arguments:**

    - ``times``: shape (t,).
    - ``u``: θ̈ of each mass at each time, shape (t, n).
    - ``system``: the system that the caption of a new figure names, or a run of it.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    return _of_masses(times, u, r"\ddot\theta", ax, system)


def _of_masses(times: np.ndarray, values: np.ndarray, symbol: str, ax: Axes | None, system: Captioned) -> Axes:
    ax = plane_axes(ax, shown=system)
    for i in range(values.shape[1]):
        ax.plot(times, values[:, i], label=f"${symbol}_{{{i + 1}}}$", **mass_line(i + 1))
    return _over_time(ax, f"${symbol}_i$")


def _over_time(ax: Axes, name: str) -> Axes:
    ax.margins(x=0)
    up_to_ticks(ax)
    label_axes(ax, "$t$", name)
    legend_above(ax)
    return ax


def convergence(
    objective: Float[np.ndarray, " k"],
    violation: Float[np.ndarray, " k"],
    gradient: Float[np.ndarray, " k"],
    ax: Axes | None = None,
    *,
    polish: int | None = None,
    system: Captioned = None,
) -> Axes:
    """Draws objective, violation and gradient norm of the best start at each report, on a logarithmic scale.

    Triangles on the lower edge mark reports without any violated constraint; other numbers that are not positive are
    left out. A line is drawn at ``polish``, the report at which the polish begins.

    **Arguments:**

    - ``objective``, ``violation``, ``gradient``: one entry for each report, shape (k,).
    - ``system``: the system that the caption of a new figure names, or a run of it.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, shown=system)
    rows = zip(("objective", "violation", "gradient"), (objective, violation, gradient), COMPONENTS, strict=True)
    for name, values, colour in rows:
        ax.plot(np.where(values > 0, values, np.nan), color=colour, linewidth=1.2, label=name, marker=".", ms=5)
    ax.set_yscale("log")
    low, high = ax.get_ylim()
    number_decades(ax.yaxis, high / low)
    feasible = np.flatnonzero(violation <= 0)
    if feasible.size:
        edge = {"transform": ax.get_xaxis_transform(), "clip_on": False, "linestyle": "none"}
        mark = {"marker": "v", "ms": 5, "mew": 1.0, "color": COMPONENTS[1], "markerfacecolor": "white"}
        ax.plot(feasible, np.zeros(feasible.size), label="none violated", **edge, **mark)
    if polish is not None:
        ax.axvline(polish - 0.5, color=SHELL, linewidth=0.8, label="polish begins")
    ax.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10], integer=True))
    label_axes(ax, "report of the search", "objective, violation,\nnorm of the gradient")
    legend_above(ax, most=3)
    return ax


def branch(
    weights: Float[np.ndarray, " points"],
    values: Mapping[str, Float[np.ndarray, " points"]],
    name: str = "weight",
    ax: Axes | None = None,
    *,
    of: str = "",
    system: Captioned = None,
) -> Axes:
    """Draws positive ``values`` of the solutions of a branch over a positive weight ``name``, both logarithmic.

    **Arguments:**

    - ``weights``: the weight of each solution, shape (points,).
    - ``of``: the label of the vertical axis; by default the names of the values.
    - ``system``: the system that the caption of a new figure names, or a run of it.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, shown=system)
    for (label, numbers), colour in zip(values.items(), itertools.cycle(COLOURS), strict=False):
        ax.plot(weights, numbers, color=colour, linewidth=1.2, marker=".", ms=4, label=label)
    ax.set_xscale("log")
    ax.set_yscale("log")
    for axis in (ax.xaxis, ax.yaxis):
        low, high = axis.get_view_interval()
        number_decades(axis, high / low)
    label_axes(ax, name, "\n".join(textwrap.wrap(of or ", ".join(values), LABEL_LETTERS)))
    legend_above(ax)
    return ax
