"""Figures of optimal control: objectives along a branch of solutions, and what the masses are told to do."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from .style import COMPONENTS, INK, legend_above, named, plane_axes


def branch(
    weights: Float[np.ndarray, " points"],
    values: Mapping[str, Float[np.ndarray, " points"]],
    name: str = "weight",
    ax: Axes | None = None,
) -> Axes:
    """Positive ``values`` of the solutions of a branch over a positive weight called ``name``, both logarithmic.

    **Arguments:**

    - ``weights``: the weight of each solution, shape (points,).

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax)
    for (label, numbers), colour in zip(values.items(), COMPONENTS, strict=False):
        ax.plot(weights, numbers, color=colour, linewidth=1.2, marker=".", ms=4, label=label)
    ax.set_xscale("log")
    ax.set_yscale("log")
    named(ax, name)
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
    for (label, places), colour in zip(found.items(), COMPONENTS, strict=False):
        ax.plot(*places, color=colour, linewidth=1.4, label=label)
    if wanted is not None:
        ax.plot(*wanted, color=INK, linewidth=0.8, linestyle=(0, (4, 2)), label="wanted")
    ax.margins(x=0)
    named(ax, "$t$", "$z$")
    legend_above(ax)
    return ax
