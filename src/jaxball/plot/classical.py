"""Figures of classical systems: their motion, what a user's function draws, and the drift of their laws."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from ..physics.body import AbstractBody
from ..physics.classical import LagrangianState
from ..physics.classical.state import OrientedState
from ..simulation.trajectory import Trajectory
from ..simulation.variables import symbol, symbol_of
from .over_time import Series, components, over_time, share_bands
from .palette import COMPONENTS, DASHED, FAINT, INK, SHELL, SOLID, mass_look
from .record import (
    COLOURS,
    Picture,
    finite_rows,
    motion_panels,
    read_picture,
    require_finite_rows,
    require_lagrangian,
    require_one,
)
from .scene import AZIMUTH_3D, MARGIN, SCENE_WIDTH, Scene, line, move, stage, write_around
from .style import (
    ABOVE,
    SMALL_FONT,
    Captioned,
    ShownFigure,
    label_axes,
    legend_above,
    linestyle,
    plane_axes,
    stacked_panels,
    up_to_ticks,
    zero_line,
)

MOTION_PANEL_HEIGHT = 1.9  # inches
LOWEST, HIGHEST = 2.0, 6.0  # inches


def lagrangian_motion(trajectory: Trajectory[Any, Any]) -> Figure:
    """Draws the coordinates of a system with a Lagrangian, positions apart from angles, their rates likewise, and λ of
    its constraints, each in a panel.

    Angles are coordinates that are called by a Greek letter or a word such as ``heading``.

    **Arguments:**

    - ``trajectory``: what :func:`jaxball.simulate` returns.

    **Raises:** ``ValueError`` for a batch, for a run without a finite state, and for one of another system.
    """
    rows, state = require_finite_rows(trajectory), require_lagrangian(trajectory)
    times, names = np.asarray(trajectory.times)[rows], trajectory.system.coordinates
    panels = {
        title: [_series(np.asarray(getattr(state, field))[rows, k], f"{names[k]}{dot}", k) for k in chosen]
        for title, field, dot, chosen in motion_panels(names)
    }
    forces = np.asarray(trajectory.multipliers)[rows]
    if forces.shape[1]:
        labels = [rf"$\lambda_{{{k + 1}}}$" if forces.shape[1] > 1 else r"$\lambda$" for k in range(forces.shape[1])]
        panels["constraint forces"] = [
            Series(values, label, COLOURS[k % len(COLOURS)])
            for k, (values, label) in enumerate(zip(forces.T, labels, strict=True))
        ]
    figure, axes = stacked_panels(len(panels), MOTION_PANEL_HEIGHT, 0.6, trajectory)
    for ax, (title, series) in zip(axes, panels.items(), strict=True):
        over_time(None, times, series, title, ax, most=6)
        ax.label_outer()
    share_bands(figure)
    return figure


def _series(values: Float[np.ndarray, " T"], name: str, k: int) -> Series:
    """Returns a coordinate or its rate, in the colour of the coordinate."""
    colours = (*COMPONENTS, *COLOURS)
    return Series(values, symbol(name) if symbol_of(name) else name, colours[k % len(colours)])


def picture_scene(trajectory: Trajectory[Any, Any], picture: Picture) -> Scene:
    """Returns the scene of a system with a Lagrangian: the points and lines that a user's function draws.

    **Raises:** ``TypeError`` and ``ValueError`` as :func:`read_picture`.
    """
    times, lines_at, everything = read_picture(trajectory, picture)
    figure, ax = stage(everything, AZIMUTH_3D) if everything.shape[1] == 3 else _plane(everything)
    artists = []
    for k, points in enumerate(lines_at(0)):
        look: dict[str, Any] = {"marker": "o", "ms": 6, "linestyle": "none"} if len(points) == 1 else {"linewidth": 1.6}
        artists.append(line(ax, color=COLOURS[k % len(COLOURS)], zorder=3, **look))
    show_clock = write_around(figure, ax, trajectory, times)

    def show(k: int) -> None:
        for artist, points in zip(artists, lines_at(k), strict=True):
            if isinstance(ax, Axes3D):
                move(artist, points)
            else:
                artist.set_data(*points.T)
        show_clock(k)

    return Scene(figure, show)


def _plane(points: Float[np.ndarray, "points 2"]) -> tuple[Figure, Any]:
    """Makes a figure that points of a plane fill, and its Axes, with a line at the height 0 if that is in view."""
    (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
    edge = 0.06 * max(right - left, high - low) or 1.0
    left, low, right, high = left - edge, low - edge, right + edge, high + 3 * edge
    height = float(np.clip(SCENE_WIDTH * (high - low) / (right - left), LOWEST, HIGHEST))
    figure = ShownFigure(figsize=(SCENE_WIDTH, round(10 * (height + 2 * MARGIN)) / 10))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(left, right), ylim=(low, high), aspect="equal")
    ax.set_axis_off()
    if low < 0 < high:
        ax.axhline(0.0, color=SHELL, linewidth=0.5, zorder=1)
    return figure, ax


LAW_PANEL_HEIGHT = 1.05  # the height of a panel, in inches
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
    figure, panels = stacked_panels(len(laws), LAW_PANEL_HEIGHT, 0.6, trajectory)
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
            f"{type(trajectory.system).__name__}; its own `plot` draws it."
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

    - ``times``: the ends of the steps, ``times`` of the report of :func:`jaxball.analysis.verify.check_laws`.
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
