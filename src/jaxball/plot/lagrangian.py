"""Figures of own systems from a Lagrangian: their motion in panels, and pictures that a user's function draws."""

import functools
import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from ..classical import LagrangianState
from ..interface.arguments import refusal, require_callable
from ..simulation.trajectory import Trajectory
from ..simulation.variables import symbol, symbol_of
from .modes import share_bands
from .over_time import Series, over_time
from .palette import COMPONENTS, INK, MASSES, SHELL
from .record import require_finite_rows
from .scene import AZIMUTH_3D, MARGIN, SCENE_WIDTH, Scene, line, move, stage, write_around
from .shown import ShownFigure
from .style import WIDE_FIGURE, caption, describe_units, title_of

MOTION_PANEL_HEIGHT = 1.9  # inches
COLOURS = (INK, *MASSES)
# Coordinates with these names, and any number after them, are angles: Greek letters, and words for turning.
ANGLES = re.compile(
    r"(alpha|beta|gamma|delta|epsilon|eta|theta|kappa|phi|varphi|psi|chi|omega|vartheta|angle|heading|lean|roll|pitch|"
    r"yaw|tilt|turn|swing|back|front)[_ ]?\w?\d*"
)
Lines = Sequence[Float[np.ndarray, "points d"]]
Picture = Callable[[float, Float[np.ndarray, " n"]], Lines]
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
    figure = ShownFigure(figsize=(WIDE_FIGURE[0], 0.6 + MOTION_PANEL_HEIGHT * len(panels)), layout="constrained")
    caption(figure, trajectory.system, title_of(trajectory), describe_units(trajectory))
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, (title, series) in zip(axes, panels.items(), strict=True):
        over_time(None, times, series, title, ax, most=6)
        ax.label_outer()
    share_bands(figure)
    return figure


def motion_panels(names: Sequence[str]) -> list[tuple[str, str, str, list[int]]]:
    """Lists the panels of coordinates with these names and of their rates: title, the state's field, what a rate's
    name ends in, and which coordinates it has.
    """
    angles = [k for k, name in enumerate(names) if ANGLES.fullmatch(name)]
    positions = [k for k in range(len(names)) if k not in angles]
    kinds = (("positions", "rates", positions), ("angles", "angular rates", angles))
    panels = [(kind, "q", "", chosen) for kind, _, chosen in kinds]
    panels += [(rates, "qdot", "dot", chosen) for _, rates, chosen in kinds]
    return [panel for panel in panels if panel[3]]


def _series(values: Float[np.ndarray, " T"], name: str, k: int) -> Series:
    """Returns a coordinate or its rate, in the colour of the coordinate."""
    colours = (*COMPONENTS, *COLOURS)
    return Series(values, symbol(name) if symbol_of(name) else name, colours[k % len(colours)])


def require_lagrangian(trajectory: Trajectory[Any, Any]) -> LagrangianState:
    """Returns the states of a run of a system with a Lagrangian.

    **Raises:** ``ValueError`` for one of another system.
    """
    if not isinstance(trajectory.state, LagrangianState):
        raise ValueError(
            "Argument `trajectory` must be of a system with a Lagrangian, but it is of a "
            f"{type(trajectory.system).__name__}; leave `picture` out, or use its method plot()."
        )
    return trajectory.state


class Drawn(NamedTuple):
    """What a user's function draws at the saved times that a run reached."""

    times: Float[np.ndarray, " T"]
    lines_at: Callable[[int], list[Float[np.ndarray, "points d"]]]  # of the k-th of these times
    points: Float[np.ndarray, "all d"]  # of all times


def read_picture(trajectory: Trajectory[Any, Any], picture: Picture) -> Drawn:
    """Reads the points and lines that a user's function draws of a system with a Lagrangian.

    **Raises:** ``TypeError`` and ``ValueError`` for a function that does not draw them, or not always as many.
    """
    rows, state = require_finite_rows(trajectory), require_lagrangian(trajectory)
    require_callable("picture", picture, "t", "q")
    times, q = np.asarray(trajectory.times)[rows], np.asarray(state.q)[rows]
    count = None

    @functools.cache
    def lines_at(k: int) -> list[np.ndarray]:
        return _lines(picture(float(times[k]), q[k]))

    for k, t in enumerate(times):
        count = len(lines_at(k)) if count is None else count
        if len(lines_at(k)) != count:
            must = f"a list of as many points and lines at every time, {count} as at t = {times[0]:g}"
            raise ValueError(f"Argument `picture` must return {must}, but at t = {t:g} it has {len(lines_at(k))}.")
    return Drawn(times, lines_at, np.concatenate([points for k in range(len(times)) for points in lines_at(k)]))


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


def _lines(drawn: Any) -> list[np.ndarray]:
    """Returns what a picture has as arrays.

    **Raises:** ``TypeError`` for anything but a list of points and lines of the same dimension.
    """
    must = "a list of points and lines, each an array of shape (points, 2) or (points, 3)"
    if not isinstance(drawn, list | tuple) or not drawn:
        raise refusal("picture(t, q)", must, drawn)
    lines = [np.atleast_2d(np.asarray(points, dtype=float)) for points in drawn]
    if any(points.ndim != 2 for points in lines) or {points.shape[1] for points in lines} not in ({2}, {3}):
        raise refusal("picture(t, q)", must, [points.shape for points in lines])
    return lines


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
