"""The moving pictures of a ball and of a disk on their plane, one frame at a time."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as Ring
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ..body import Disk, System
from ..trajectory import Trajectory
from .record import Record
from .shapes import outline, rail_points, split, towards, wireframe
from .style import FAINT, INK, SHELL, SMALL, TRAIL, mass_colour, mass_line

ELEVATION, AZIMUTH = 26.0, -60.0  # degrees
WIDTH, MARGIN, HEADER = 8.0, 0.15, 0.5  # inches


class Scene(NamedTuple):
    """A figure, and what makes it show the k-th saved time."""

    figure: Figure
    show: Callable[[int], None]


def scene(trajectory: Trajectory, seen: Record) -> Scene:
    """The scene of a ball, in space, or of a disk, in its plane."""
    make = _disk_scene if isinstance(trajectory.system, Disk) else _ball_scene
    return make(trajectory.system, seen)


def _ball_scene(system: System, seen: Record) -> Scene:
    r = float(system.radius)
    path = seen.seen.contact_point
    low, high = path[:, :2].min(axis=0) - 1.3 * r, path[:, :2].max(axis=0) + 1.3 * r
    viewer = towards(ELEVATION, AZIMUTH)
    wire, silhouette = wireframe(r), outline(r, viewer)
    floor = np.array([(x, y, -r) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]) * [*(high - low), 1.0] + [*low, 0.0]
    visited = (seen.seen.geometric_centre[:, None] + silhouette[::8]).reshape(-1, 3)
    figure, ax = _stage(np.concatenate([floor, visited]), floor.min(axis=0), np.append(high, r))
    _floor(ax, floor, r)
    trail = _line(ax, color=TRAIL, linewidth=1.8, zorder=2)
    shade = Poly3DCollection([silhouette], facecolor="white", edgecolor="none", alpha=0.7, zorder=3)
    ax.add_collection3d(shade)
    back = _line(ax, color=FAINT, linewidth=0.6, zorder=4)
    front = _line(ax, color="0.6", linewidth=0.6, zorder=7)
    edge = _line(ax, color=SHELL, linewidth=1.2, zorder=7)
    show_inside = _inside(figure, ax, system, seen, r)

    def show(k: int) -> None:
        centre = seen.seen.geometric_centre[k]
        near, far = split(wire @ seen.Lambda[k].T, viewer)
        for artist, points in ((front, near), (back, far), (edge, silhouette)):
            _place(artist, centre + points)
        shade.set_verts([centre + silhouette])
        _place(trail, path[: k + 1])
        show_inside(k)

    return Scene(figure, show)


def _stage(
    points: Float[np.ndarray, "points 3"], low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]
) -> tuple[Figure, Axes3D]:
    """A figure that ``points`` fill, and its Axes, without a frame, whose limits are ``low`` and ``high``."""
    figure = Figure(figsize=(WIDTH, WIDTH))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    assert isinstance(ax, Axes3D)
    ax.set_proj_type("ortho")
    ax.view_init(elev=ELEVATION, azim=AZIMUTH)
    ax.set_axis_off()
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set_box_aspect(high - low)
    x, y, _ = proj3d.proj_transform(*points.T, ax.get_proj())
    inches = ax.transData.transform(np.column_stack([x, y])) / figure.dpi
    left, bottom = inches.min(axis=0)
    width, height = inches.max(axis=0) - inches.min(axis=0)
    # The Axes are square and may reach beyond the figure, because they cut off what is beyond them.
    scale = min((WIDTH - 2 * MARGIN) / width, (0.9 * WIDTH - HEADER) / height)
    tall = round((scale * height + MARGIN + HEADER) * 10) / 10
    corner = 0.5 * (WIDTH - scale * width) - scale * left, MARGIN - scale * bottom
    figure.set_size_inches(WIDTH, tall)
    side = scale * WIDTH
    ax.set_position((corner[0] / WIDTH, corner[1] / tall, side / WIDTH, side / tall))
    return figure, ax


def _floor(ax: Axes3D, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"], r: float) -> None:
    """The plane, with lines at every whole multiple of the radius."""
    corners = [(low[0], low[1], -r), (high[0], low[1], -r), (high[0], high[1], -r), (low[0], high[1], -r)]
    ax.add_collection3d(
        Poly3DCollection([corners], facecolor="0.965", edgecolor="none", zorder=0)
    )
    for x in r * np.arange(np.ceil(low[0] / r), np.floor(high[0] / r) + 1):
        ax.plot([x, x], [low[1], high[1]], [-r, -r], color="0.88", linewidth=0.6, zorder=1)
    for y in r * np.arange(np.ceil(low[1] / r), np.floor(high[1] / r) + 1):
        ax.plot([low[0], high[0]], [y, y], [-r, -r], color="0.88", linewidth=0.6, zorder=1)


def _disk_scene(system: System, seen: Record) -> Scene:
    r = float(system.radius)
    z = seen.seen.geometric_centre[:, 0]
    left, right, bottom, top = z.min() - 1.3 * r, z.max() + 1.3 * r, -1.25 * r, 1.55 * r
    height = np.clip(WIDTH * (top - bottom) / (right - left), 2.0, 6.0)
    figure = Figure(figsize=(WIDTH, round(10 * float(height)) / 10))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(left, right), ylim=(bottom, top), aspect="equal")
    ax.set_axis_off()
    ax.plot([left, right], [-r, -r], color=SHELL, linewidth=1.2, zorder=1)
    for x in r * np.arange(np.ceil(left / r), np.floor(right / r) + 1):
        ax.plot([x, x], [-1.06 * r, -r], color=SHELL, linewidth=0.8, zorder=1)

    trail = _line(ax, color=TRAIL, linewidth=3.0, zorder=2, solid_capstyle="butt")
    shell = ax.add_patch(Ring((0.0, 0.0), r, facecolor="0.985", edgecolor=SHELL, linewidth=1.4, zorder=3))
    spokes = _line(ax, color="0.75", linewidth=0.8, zorder=3)
    show_inside = _inside(figure, ax, system, seen, r)

    def show(k: int) -> None:
        centre = seen.seen.geometric_centre[k]
        shell.set_center((centre[0], centre[2]))
        _place(spokes, centre + _spokes(r) @ seen.Lambda[k].T)
        _place(trail, seen.seen.contact_point[: k + 1])
        show_inside(k)

    return Scene(figure, show)


def _spokes(r: float) -> Float[np.ndarray, "points 3"]:
    """One spoke along E1 and marks all round the rim, as one curve with breaks."""
    nothing = np.full(3, np.nan)
    points = [np.zeros(3), np.array([r, 0.0, 0.0]), nothing]
    for angle in np.arange(1, 12) * np.pi / 6:
        n = np.array([np.cos(angle), 0.0, np.sin(angle)])
        points += [0.94 * r * n, r * n, nothing]
    return np.stack(points)


def _inside(figure: Figure, ax: Axes, system: System, seen: Record, r: float) -> Callable[[int], None]:
    """Rails, masses, centre of mass and a clock, and what moves them to the k-th saved time."""
    masses = list(enumerate(system.point_masses, start=1))
    curves = ((i, rail_points(mass.motion, r)) for i, mass in masses)
    rails = [
        (points, _line(ax, **(mass_line(i) | {"linewidth": 0.9}), zorder=5))
        for i, points in curves
        if points is not None
    ]
    dot = {"marker": "o", "ms": 8, "markeredgecolor": "white", "mew": 0.8, "linestyle": "none", "zorder": 6}
    dots = [_line(ax, **dot, color=mass_colour(i), label=f"$m_{{{i}}}$") for i, _ in masses]
    star = _line(ax, **(dot | {"marker": "*", "ms": 10}), color=INK, label="CM")
    figure.legend(
        loc="upper right", ncols=min(len(dots) + 1, 7), frameon=False, prop=SMALL, handletextpad=0.2
    )
    clock = figure.text(0.02, 0.98, "", fontproperties=SMALL, ha="left", va="top")

    def show(k: int) -> None:
        centre = seen.seen.geometric_centre[k]
        for points, artist in rails:
            _place(artist, centre + points @ seen.Lambda[k].T)
        for artist, point in zip(dots, seen.seen.mass_positions_space[k], strict=True):
            _place(artist, centre + point[None])
        _place(star, centre + seen.seen.centre_of_mass_space[k][None])
        clock.set_text(f"$t = {seen.times[k]:.2f}$")

    return show


def _line(ax: Axes, **look) -> Line2D:
    empty = [[]] * (3 if isinstance(ax, Axes3D) else 2)
    return ax.plot(*empty, **look)[0]


def _place(line: Line2D, points: Float[np.ndarray, "points 3"]) -> None:
    """Moves a line to ``points``; in a plane figure, to their first and third coordinates."""
    if isinstance(line.axes, Axes3D):
        line.set_data_3d(*points.T)  # pyright: ignore[reportAttributeAccessIssue]
    else:
        line.set_data(points[:, 0], points[:, 2])
