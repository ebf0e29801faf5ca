"""Figures of optimal control: objectives along a branch of solutions, and what the masses are told to do."""

import itertools
import textwrap
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from .style import COMPONENTS, DASHED, INK, MASSES, TRAIL, legend_above, named, number_decades, plane_axes, up_to_ticks

COLOURS = (*COMPONENTS, INK, *MASSES)
PATHS = ("0.6", TRAIL, *COLOURS)  # grey before and red after, as in the plane
LETTERS = 36  # of a label along the axis upwards


def branch(
    weights: Float[np.ndarray, " points"],
    values: Mapping[str, Float[np.ndarray, " points"]],
    name: str = "weight",
    ax: Axes | None = None,
    *,
    of: str = "",
) -> Axes:
    """Positive ``values`` of the solutions of a branch over a positive weight called ``name``, both logarithmic.

    **Arguments:**

    - ``weights``: the weight of each solution, shape (points,).
    - ``of``: on the axis upwards, what the values are; if not given, their names.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax)
    for (label, numbers), colour in zip(values.items(), itertools.cycle(COLOURS), strict=False):
        ax.plot(weights, numbers, color=colour, linewidth=1.2, marker=".", ms=4, label=label)
    ax.set_xscale("log")
    ax.set_yscale("log")
    for axis in (ax.xaxis, ax.yaxis):
        low, high = axis.get_view_interval()
        number_decades(axis, high / low)
    named(ax, name, "\n".join(textwrap.wrap(of or ", ".join(values), LETTERS)))
    legend_above(ax)
    return ax


def place_in_time(
    found: Mapping[str, tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]],
    wanted: tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """z of a disk over time, in each case by its name as times and places, and where it was wanted, dashed.

    **Arguments:**

    - ``found``: times and places of each case, by its name.
    - ``wanted``: times and places, or None.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax)
    for (label, places), colour in zip(found.items(), itertools.cycle(PATHS), strict=False):
        ax.plot(*places, color=colour, linewidth=1.4, label=label)
    if wanted is not None:
        ax.plot(*wanted, color=INK, linewidth=0.8, linestyle=DASHED, label="wanted")
    ax.margins(x=0)
    up_to_ticks(ax)
    named(ax, "$t$", "$z$")
    legend_above(ax)
    return ax
