"""The scene of an animation, a ball or a disk on its plane, one frame at a time."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as Ring
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ..physics.body import Disk, System
from ..simulation.trajectory import Trajectory
from .mechanisms import arms_of_run, looks
from .record import Record
from .shapes import outline, rail_points, split, towards, wireframe
from .style import CAPTION, FAINT, INK, SHELL, SMALL, TRAIL, mass_colour, mass_line, subject

ELEVATION, AZIMUTH = 26.0, -60.0  # degrees
WIDTH, MARGIN, HEADER = 8.0, 0.15, 0.5  # inches


class Scene(NamedTuple):
    """A figure, and the function that makes it show the k-th saved time."""

    figure: Figure
    show: Callable[[int], None]


def scene(trajectory: Trajectory, run: Record) -> Scene:
    """The scene of a ball in space, or of a disk in its plane."""
    make = _disk_scene if isinstance(trajectory.system, Disk) else _ball_scene
    return make(trajectory.system, run, arms_of_run(trajectory))


Arms = list[Float[np.ndarray, "T n points 3"]]  # of each mechanism


def _ball_scene(system: System, run: Record, arms: Arms) -> Scene:
    r = float(system.radius)
    viewer = towards(ELEVATION, AZIMUTH)
    wire, silhouette = wireframe(r), outline(r, viewer)
    centres, path = run.observables.geometric_centre, run.observables.contact_point
    low = np.subtract(path.min(axis=0), [1.3 * r, 1.3 * r, 0.0])
    high = np.add(path.max(axis=0), [1.3 * r, 1.3 * r, 2 * r])
    figure, ax = _stage(low, high, (centres[:, None] + silhouette[::8]).reshape(-1, 3))
    _floor(ax, low, high, r)

    trail = _line(ax, color=TRAIL, linewidth=1.8, zorder=2)
    shade = Poly3DCollection([silhouette], facecolor="white", edgecolor="none", alpha=0.7, zorder=3)
    ax.add_collection3d(shade)
    back = _line(ax, color=FAINT, linewidth=0.6, zorder=4)
    front = _line(ax, color="0.6", linewidth=0.6, zorder=7)
    edge = _line(ax, color=SHELL, linewidth=1.2, zorder=7)
    show_contents = _contents(figure, ax, system, run, arms)

    def show(k: int) -> None:
        near, far = split(wire @ run.Lambda[k].T, viewer)
        for line, points in ((front, near), (back, far), (edge, silhouette)):
            _move(line, centres[k] + points)
        shade.set_verts([centres[k] + silhouette])
        _move(trail, path[: k + 1])
        show_contents(k)

    return Scene(figure, show)


def _stage(
    low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], visited: Float[np.ndarray, "points 3"]
) -> tuple[Figure, Axes3D]:
    """A figure that the floor and the points ``visited`` fill, and its Axes, from ``low`` to ``high``."""
    figure = Figure(figsize=(WIDTH, WIDTH))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    assert isinstance(ax, Axes3D)
    ax.set_proj_type("ortho")
    ax.view_init(elev=ELEVATION, azim=AZIMUTH)
    ax.set_axis_off()
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set_box_aspect(tuple(high - low))
    content = np.concatenate([_rectangle(low, high), visited])
    x, y, _ = proj3d.proj_transform(*content.T, ax.get_proj())  # pyright: ignore[reportCallIssue]
    inches = ax.transData.transform(np.column_stack([x, y])) / figure.dpi
    (left, bottom), (width, height) = inches.min(axis=0), np.ptp(inches, axis=0)
    scale = min((WIDTH - 2 * MARGIN) / width, (WIDTH - MARGIN - HEADER) / height)
    tall = round(10 * (scale * height + MARGIN + HEADER)) / 10
    # The Axes stay square and extend beyond the figure, because they clip what is outside of them.
    corner = (WIDTH - scale * width) / 2 - scale * left, MARGIN - scale * bottom
    side = scale * WIDTH
    figure.set_size_inches(WIDTH, tall)
    ax.set_position((corner[0] / WIDTH, corner[1] / tall, side / WIDTH, side / tall))
    return figure, ax


def _rectangle(low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 3"]:
    """The corners of the floor."""
    xs, ys = (low[0], high[0], high[0], low[0]), (low[1], low[1], high[1], high[1])
    return np.column_stack([xs, ys, np.full(4, low[2])])


def _floor(ax: Axes3D, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"], r: float) -> None:
    """The plane, with lines at every whole multiple of the radius."""
    face = Poly3DCollection([_rectangle(low, high)], facecolor="0.965", edgecolor="none", zorder=0)
    ax.add_collection3d(face)
    look: dict[str, Any] = {"color": "0.88", "linewidth": 0.6, "zorder": 1}
    for x in _multiples(r, low[0], high[0]):
        ax.plot([x, x], [low[1], high[1]], [low[2], low[2]], **look)
    for y in _multiples(r, low[1], high[1]):
        ax.plot([low[0], high[0]], [y, y], [low[2], low[2]], **look)


def _multiples(r: float, low: float, high: float) -> Float[np.ndarray, " n"]:
    """The whole multiples of ``r`` from ``low`` to ``high``."""
    return r * np.arange(int(np.ceil(low / r)), int(np.floor(high / r)) + 1)


def _disk_scene(system: System, run: Record, arms: Arms) -> Scene:
    r = float(system.radius)
    centres, path = run.observables.geometric_centre, run.observables.contact_point
    z = centres[:, 0]
    left, right, bottom, top = z.min() - 1.3 * r, z.max() + 1.3 * r, -1.25 * r, 1.55 * r
    height = np.clip(WIDTH * (top - bottom) / (right - left), 2.0, 6.0)
    figure = Figure(figsize=(WIDTH, round(10 * float(height)) / 10))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(left, right), ylim=(bottom, top), aspect="equal")
    ax.set_axis_off()
    ax.plot([left, right], [-r, -r], color=SHELL, linewidth=1.2, zorder=1)
    for x in _multiples(r, left, right):
        ax.plot([x, x], [-1.06 * r, -r], color=SHELL, linewidth=0.8, zorder=1)

    trail = _line(ax, color=TRAIL, linewidth=3.0, zorder=2, solid_capstyle="butt")
    shell = Ring((0.0, 0.0), r, facecolor="0.985", edgecolor=SHELL, linewidth=1.4, zorder=3)
    ax.add_patch(shell)
    spokes = _line(ax, color="0.75", linewidth=0.8, zorder=3)
    show_contents = _contents(figure, ax, system, run, arms)

    def show(k: int) -> None:
        shell.set_center((centres[k, 0], centres[k, 2]))
        _move(spokes, centres[k] + _spokes(r) @ run.Lambda[k].T)
        _move(trail, path[: k + 1])
        show_contents(k)

    return Scene(figure, show)


def _spokes(r: float) -> Float[np.ndarray, "points 3"]:
    """A spoke along E1 and marks around the rim, as one curve with breaks."""
    gap = np.full(3, np.nan)
    points = [np.zeros(3), np.array([r, 0.0, 0.0]), gap]
    for angle in np.arange(1, 12) * np.pi / 6:
        n = np.array([np.cos(angle), 0.0, np.sin(angle)])
        points += [0.94 * r * n, r * n, gap]
    return np.stack(points)


def _contents(figure: Figure, ax: Axes, system: System, run: Record, arms: Arms) -> Callable[[int], None]:
    """Draws rails, masses, centre of mass and a clock, and returns what moves them to the k-th saved time."""
    masses = list(enumerate(system.point_masses, start=1))
    curves = ((i, rail_points(mass.motion, float(system.radius))) for i, mass in masses)
    rails = [(points, _line(ax, **mass_line(i, linewidth=0.9, zorder=5))) for i, points in curves if points is not None]
    dot: dict[str, Any] = {
        "marker": "o",
        "ms": 8,
        "markeredgecolor": "white",
        "mew": 0.8,
        "linestyle": "none",
        "zorder": 6,
    }
    rods = [
        (points[:, i], _line(ax, color=mass_colour(j), linewidth=1.4, zorder=5.5))
        for j, points in enumerate(arms, start=system.n_masses + 1)
        for i in range(points.shape[1])
    ]
    shown = looks(system)
    names = [look.name if look not in shown[:k] else "" for k, look in enumerate(shown)]
    dots = [_line(ax, **dot, color=look.colour, label=name) for look, name in zip(shown, names, strict=True)]
    star = _line(ax, **(dot | {"marker": "*", "ms": 10}), color=INK, label="CM")
    figure.legend(loc="upper right", ncols=min(len(set(shown)) + 1, 7), frameon=False, prop=SMALL, handletextpad=0.2)
    figure.text(0.5, 0.02 / figure.get_figheight(), subject(system), ha="center", va="bottom", **CAPTION)
    clock = figure.text(0.02, 0.98, "", fontproperties=SMALL, ha="left", va="top")

    def show(k: int) -> None:
        centre = run.observables.geometric_centre[k]
        for points, artist in rails:
            _move(artist, centre + points @ run.Lambda[k].T)
        for points, artist in rods:
            _move(artist, centre + points[k] @ run.Lambda[k].T)
        for artist, point in zip(dots, run.observables.mass_positions_space[k], strict=True):
            _move(artist, centre + point[None])
        _move(star, centre + run.observables.centre_of_mass_space[k][None])
        clock.set_text(f"$t = {run.times[k]:.2f}$")

    return show


def _line(ax: Axes, **look) -> Line2D:
    empty = [[]] * (3 if isinstance(ax, Axes3D) else 2)
    return ax.plot(*empty, **look)[0]


def _move(line: Line2D, points: Float[np.ndarray, "points 3"]) -> None:
    """Moves a line to ``points``; in a plane figure, to their first and third coordinates."""
    if isinstance(line.axes, Axes3D):
        line.set_data_3d(*points.T)  # pyright: ignore[reportAttributeAccessIssue]
    else:
        line.set_data(points[:, 0], points[:, 2])
