"""Laws and conserved quantities: the motion of a classical system, the drift of its integrals, and residuals."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..classical import LagrangianState
from ..classical.state import OrientedState
from ..physics.body import AbstractBody
from ..simulation.trajectory import Trajectory
from ..simulation.variables import symbol, symbol_of
from .over_time import Series, components, over_time
from .palette import COMPONENTS, DASHED, FAINT, INK, MASSES, SOLID, mass_look
from .record import finite_rows, require_one
from .shown import ShownFigure
from .style import (
    ABOVE,
    SMALL_FONT,
    WIDE_FIGURE,
    Captioned,
    caption_of,
    label_axes,
    legend_above,
    linestyle,
    plane_axes,
    up_to_ticks,
    zero_line,
)

LAW_PANEL_HEIGHT = 1.05  # the height of a panel, in inches
COLOURS = (INK, *MASSES)
LEAST_DRAWN = 1e-8  # of the expected residual: smaller ones are drawn here
ROW = 4  # entries in a row of the legend


def classical_motion(trajectory: Trajectory[Any, Any], ax: Axes | None = None) -> Axes:
    """Draws the body components Ω_i of a rigid body, or every number of another state.

    A coordinate and its rate have the same colour; the rate is dashed.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a batch, for a ball or a disk, and for a three-dimensional ``ax``.
    """
    rows = _rows(trajectory)
    times, state = np.asarray(trajectory.times)[rows], trajectory.state
    if isinstance(state, OrientedState):
        Omega = components(np.asarray(state.Omega)[rows], r"\Omega")
        return over_time(trajectory, times, Omega, r"$\Omega_i$", ax)
    # Coordinates of a particle have the colours of axes; others follow in turn, with one colour for each and its
    # rate.
    series, colours = [], {(letter, 0): colour for letter, colour in zip("xyz", COMPONENTS, strict=True)}
    for name, leaf in _numbers(trajectory).items():
        for k, values in enumerate(np.asarray(leaf).reshape(len(trajectory.times), -1).T):
            label = symbol(name) if symbol_of(name) else name if leaf.ndim == 1 else f"{name} {k + 1}"
            others = len(colours) - len(COMPONENTS)
            colour = colours.setdefault((name.removesuffix("dot"), k), COLOURS[others % len(COLOURS)])
            series.append(Series(values[rows], label, colour, DASHED if name.endswith("dot") else SOLID))
    return over_time(trajectory, times, series, "state", ax, most=6)


def _numbers(trajectory: Trajectory[Any, Any]) -> dict[str, Any]:
    """Returns the fields of the state; for a system with a Lagrangian, its coordinates and their rates by name."""
    state = trajectory.state
    if not isinstance(state, LagrangianState):
        return vars(state)
    names = trajectory.system.coordinates
    return {
        f"{name}{dot}": x
        for dot, of in (("", state.q), ("dot", state.qdot))
        for name, x in zip(names, of.T, strict=True)
    }


def law_errors(trajectory: Trajectory[Any, Any]) -> Figure:
    """Draws the change of each conserved quantity since the start, in a panel of its own; for a vector, each component.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a batch, and for a ball or a disk.
    """
    rows = _rows(trajectory)
    times, laws = np.asarray(trajectory.times)[rows], trajectory.laws._asdict()
    figure = ShownFigure(figsize=(WIDE_FIGURE[0], 0.6 + LAW_PANEL_HEIGHT * len(laws)), layout="constrained")
    caption_of(figure, trajectory)
    panels = figure.subplots(len(laws), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (name, leaf) in zip(panels, laws.items(), strict=True):
        values = np.asarray(leaf)[rows].reshape(len(rows), -1)
        _panel(ax, times, values - values[:1], symbol(name) if symbol_of(name) else name.replace("_", " "))
    label_axes(panels[-1], "$t$")
    return figure


def _panel(ax: Axes, times: Float[np.ndarray, " T"], changes: Float[np.ndarray, "T k"], name: str) -> None:
    """Draws the changes of a quantity, in units of a power of ten."""
    plane_axes(ax)
    largest = float(np.max(np.abs(changes), initial=0.0))
    # Each in its own power of ten, because laws differ by many.
    power = math.floor(math.log10(largest)) if largest > 0 else 0
    zero_line(ax)
    for k, values in enumerate(changes.T):
        colour = (*COMPONENTS, *COLOURS)[k % (len(COMPONENTS) + len(COLOURS))]
        ax.plot(times, values * 10.0**-power, color=colour, linewidth=0.9, label=str(k + 1))
    ax.margins(x=0)
    ax.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
    up_to_ticks(ax)
    scale = f", in $10^{{{power}}}$" if power else ""
    change = f"change since the start{scale}" if largest > 0 else "no change"
    ax.set_title(f"{name}: {change}", fontproperties=SMALL_FONT, loc="left", pad=5)
    if changes.shape[1] > 1:
        narrow: dict[str, Any] = {"handlelength": 1.0, "columnspacing": 0.8, "handletextpad": 0.4, "borderaxespad": 0.0}
        ax.legend(ncols=3, **(ABOVE | {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}), **narrow, borderpad=0.1)


def _rows(trajectory: Trajectory[Any, Any]) -> np.ndarray:
    require_one(trajectory)
    if isinstance(trajectory.system, AbstractBody):
        raise ValueError(
            "Argument `trajectory` must be of a classical system, but it is of a "
            f"{type(trajectory.system).__name__}; the other functions of jaxball.plot draw it."
        )
    return finite_rows(trajectory)


def law_residuals(
    times: Float[np.ndarray, " n"],
    residuals: Mapping[str, Float[np.ndarray, " n"]],
    ax: Axes | None = None,
    *,
    system: Captioned = None,
) -> Axes:
    """Draws how far a run departs from each law over time, on a logarithmic axis.

    The residuals are multiples of those that the tolerances explain, so that a law holds as long as its curve is below
    the dashed line at 1.

    **Arguments:**

    - ``times``: the ends of the steps, ``times`` of the report of :func:`jaxball.verify.verify`.
    - ``residuals``: those of each law by its name, ``residuals`` of the report.
    - ``system``: the system that the caption of a new figure names, or a run of it.

    **Raises:** ``ValueError`` when ``ax`` is three-dimensional.
    """
    ax = plane_axes(ax, shown=system)
    for k, (law, values) in enumerate(residuals.items()):
        colour, dashes = mass_look(k + 1)
        # Not 0, which a logarithmic axis cannot show.
        name, values = law.replace("_", " "), np.maximum(values, LEAST_DRAWN)
        ax.semilogy(times, values, color=colour, linestyle=linestyle(dashes), linewidth=0.9, label=name)
    ax.axhline(1.0, color=INK, linestyle=linestyle(DASHED), linewidth=0.8)
    ax.margins(x=0)
    ax.grid(axis="y", color=FAINT, linewidth=0.4)
    label_axes(ax, "$t$", "residual / expected")
    legend_above(ax, ROW)
    return ax
