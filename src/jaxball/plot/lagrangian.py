"""Figures of own systems from a Lagrangian: their motion in panels, and pictures that a user's function draws."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from ..simulation.trajectory import Trajectory
from ..simulation.variables import symbol, symbol_of
from .modes import share_bands
from .over_time import Series, over_time
from .palette import COMPONENTS, SHELL
from .pictures import COLOURS, Picture, motion_panels, read_picture, require_lagrangian
from .record import require_finite_rows
from .scene import AZIMUTH_3D, MARGIN, SCENE_WIDTH, Scene, line, move, stage, write_around
from .shown import ShownFigure
from .style import WIDE_FIGURE, caption_of

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
    figure = ShownFigure(figsize=(WIDE_FIGURE[0], 0.6 + MOTION_PANEL_HEIGHT * len(panels)), layout="constrained")
    caption_of(figure, trajectory)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
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
