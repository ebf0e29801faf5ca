"""The scene of an animation, a ball or a disk on its plane, one frame at a time."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle as Ring
from matplotlib.text import Text
from matplotlib.transforms import ScaledTranslation
from mpl_toolkits.mplot3d import Axes3D, proj3d

from ..physics.body import Disk
from ..simulation.trajectory import Trajectory
from .floor import Placed, Setting, draw_floor, draw_ground, floor_under, ground_under, place, setting_of
from .mechanisms import arms_of_run, looks
from .modes import modes_of
from .moving import face, line, move
from .palette import FAINT, INK, SHELL, mass_colour
from .record import Record
from .shapes import outline, parallel, rail_points, split, towards, wireframe
from .style import CAPTION, SMALL, mass_line, subject
from .trail import draw_trail

ELEVATION, AZIMUTH = 26.0, -60.0  # degrees
WIDTH, MARGIN, HEADER = 8.0, 0.15, 0.5  # inches
SHADOW = "0.88"
BASELINE = -15.0  # of the clock, in points from the upper edge


class Scene(NamedTuple):
    """A figure, and a function that makes it show the k-th saved time."""

    figure: Figure
    show: Callable[[int], None]


def scene(trajectory: Trajectory, run: Record) -> Scene:
    """The scene of a ball in space, or of a disk in its plane; gravity points down."""
    make = _disk_scene if isinstance(trajectory.system, Disk) else _ball_scene
    return make(trajectory, run, arms_of_run(trajectory), setting_of(trajectory.system, run.times))


Arms = list[Float[np.ndarray, "T n points 3"]]  # of each mechanism


def _ball_scene(trajectory: Trajectory, run: Record, arms: Arms, setting: Setting) -> Scene:
    system, placed = trajectory.system, place(run, setting)
    r = float(system.radius)
    # A slope is seen from its side, so that it is visible, and never from below.
    azimuth = AZIMUTH + setting.downhill
    viewer = towards(ELEVATION, azimuth)
    wire, silhouette = wireframe(r), outline(r, viewer)
    floor = floor_under(run.observables.contact_point, r, setting)
    visited = (placed.centre[:, None] + silhouette[::8]).reshape(-1, 3)
    figure, ax = _stage(np.concatenate([floor.block.everywhere(setting.moved), visited]), azimuth)
    show_floor = draw_floor(ax, floor, setting, r, viewer)

    show_shadow = _draw_shadow(ax, placed, setting, r) if trajectory.contact is not None else None
    show_trail = draw_trail(ax, trajectory, placed, setting, linewidth=1.8, zorder=2)
    shade = face(ax, facecolor="white", alpha=0.7, zorder=3)
    back = line(ax, color=FAINT, linewidth=0.6, zorder=4)
    front = line(ax, color="0.6", linewidth=0.6, zorder=7)
    edge = line(ax, color=SHELL, linewidth=1.2, zorder=7)
    show_contents = _contents(figure, ax, trajectory, placed, arms)

    def show(k: int) -> None:
        near, far = split(wire @ placed.Lambda[k].T, viewer)
        for artist, points in ((front, near), (back, far), (edge, silhouette)):
            move(artist, placed.centre[k] + points)
        shade.set_verts([placed.centre[k] + silhouette])
        if show_shadow is not None:
            show_shadow(k)
        show_trail(k)
        show_floor(k)
        show_contents(k)

    return Scene(figure, show)


def _draw_shadow(ax: Axes3D, placed: Placed, setting: Setting, r: float) -> Callable[[int], None]:
    """Draws a shadow below a ball that may leave the plane, so that its height is visible."""
    shadow, round_ = face(ax, facecolor=SHADOW, zorder=1.5), r * parallel(0.0) @ setting.page.T

    def show(k: int) -> None:
        shadow.set_verts([placed.path[k] + placed.moved[k] + round_])

    return show


def _stage(content: Float[np.ndarray, "points 3"], azimuth: float) -> tuple[Figure, Axes3D]:
    """A figure that the points ``content`` fill, and its Axes, seen from ``azimuth``."""
    low, high = content.min(axis=0), content.max(axis=0)
    figure = Figure(figsize=(WIDTH, WIDTH))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    assert isinstance(ax, Axes3D)
    ax.set_proj_type("ortho")
    ax.view_init(elev=ELEVATION, azim=azimuth)
    ax.set_axis_off()
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set_box_aspect(tuple(high - low))
    x, y, _ = proj3d.proj_transform(*content.T, ax.get_proj())  # pyright: ignore[reportCallIssue]
    inches = ax.transData.transform(np.column_stack([x, y])) / figure.dpi
    (left, bottom), (width, height) = inches.min(axis=0), np.ptp(inches, axis=0)
    scale = min((WIDTH - 2 * MARGIN) / width, (WIDTH - MARGIN - HEADER) / height)
    tall = round(10 * (scale * height + MARGIN + HEADER)) / 10
    # The Axes stay square and extend beyond the figure, because they clip what is outside.
    corner = (WIDTH - scale * width) / 2 - scale * left, MARGIN - scale * bottom
    side = scale * WIDTH
    figure.set_size_inches(WIDTH, tall)
    ax.set_position((corner[0] / WIDTH, corner[1] / tall, side / WIDTH, side / tall))
    return figure, ax


def _disk_scene(trajectory: Trajectory, run: Record, arms: Arms, setting: Setting) -> Scene:
    system, placed, path = trajectory.system, place(run, setting), run.observables.contact_point
    r = float(system.radius)
    around = [placed.centre + aside for aside in ([-1.1 * r, 0.0, 0.0], [1.1 * r, 0.0, 0.0])]
    content = np.concatenate([ground_under(path, r, setting).everywhere(setting.moved), *around])
    (left, _, low), (right, _, high) = content.min(axis=0), content.max(axis=0)
    bottom, top = low - 0.25 * r, high + 1.55 * r
    height = np.clip(WIDTH * (top - bottom) / (right - left), 2.0, 6.0)
    figure = Figure(figsize=(WIDTH, round(10 * float(height)) / 10))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(left, right), ylim=(bottom, top), aspect="equal")
    ax.set_axis_off()
    show_ground = draw_ground(ax, path, r, setting)

    show_trail = draw_trail(ax, trajectory, placed, setting, linewidth=3.0, zorder=2, solid_capstyle="butt")
    shell = Ring((0.0, 0.0), r, facecolor="0.985", edgecolor=SHELL, linewidth=1.4, zorder=3, animated=True)
    ax.add_patch(shell)
    spokes = line(ax, color="0.75", linewidth=0.8, zorder=3)
    show_contents = _contents(figure, ax, trajectory, placed, arms)

    def show(k: int) -> None:
        shell.set_center((placed.centre[k, 0], placed.centre[k, 2]))
        move(spokes, placed.centre[k] + _spokes(r) @ placed.Lambda[k].T)
        show_trail(k)
        show_ground(k)
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


def _contents(figure: Figure, ax: Axes, trajectory: Trajectory, placed: Placed, arms: Arms) -> Callable[[int], None]:
    """Draws rails, masses, centre of mass and a clock, and returns a function that moves them to the k-th saved time.

    For a run with a law of contact, the clock shows the mode too.
    """
    system, modes = trajectory.system, modes_of(trajectory)
    words = [""] * len(placed.times) if modes is None else [f"  {mode.name.lower()}" for mode in modes.at(placed.times)]
    masses = list(enumerate(system.point_masses, start=1))
    curves = ((i, rail_points(mass.motion, float(system.radius))) for i, mass in masses)
    rails = [(points, line(ax, **mass_line(i, linewidth=0.9, zorder=5))) for i, points in curves if points is not None]
    dot: dict[str, Any] = {
        "marker": "o",
        "ms": 8,
        "markeredgecolor": "white",
        "mew": 0.8,
        "linestyle": "none",
        "zorder": 6,
    }
    rods = [
        (points[:, i], line(ax, color=mass_colour(j), linewidth=1.4, zorder=5.5))
        for j, points in enumerate(arms, start=system.n_masses + 1)
        for i in range(points.shape[1])
    ]
    shown = looks(system)
    names = [look.name if look not in shown[:k] else "" for k, look in enumerate(shown)]
    dots = [line(ax, **dot, color=look.colour, label=name) for look, name in zip(shown, names, strict=True)]
    star = line(ax, **(dot | {"marker": "*", "ms": 10}), color=INK, label="CM")
    figure.legend(loc="upper right", ncols=min(len(set(shown)) + 1, 7), frameon=False, prop=SMALL, handletextpad=0.2)
    figure.text(0.5, 0.02 / figure.get_figheight(), subject(system), ha="center", va="bottom", **CAPTION)
    clock = _clock(figure, ax)

    def show(k: int) -> None:
        centre, turn = placed.centre[k], placed.Lambda[k].T
        for points, artist in rails:
            move(artist, centre + points @ turn)
        for points, artist in rods:
            move(artist, centre + points[k] @ turn)
        for artist, point in zip(dots, placed.masses[k], strict=True):
            move(artist, centre + point[None])
        move(star, centre + placed.centre_of_mass[k][None])
        clock.set_text(f"{placed.times[k]:.2f}".replace("-", "\N{MINUS SIGN}") + words[k])

    return show


def _clock(figure: Figure, ax: Axes) -> Text:
    """Writes "t =" into the upper left corner, and returns the text after it, plain because formulas are slow."""
    corner = figure.transFigure + ScaledTranslation(0.0, BASELINE / 72, figure.dpi_scale_trans)
    name = figure.text(0.02, 1.0, "$t =$", fontproperties=SMALL, transform=corner)
    behind: dict[str, Any] = {"xycoords": name, "xytext": (2.5, 0.0), "textcoords": "offset points"}
    return ax.annotate(
        "", (1.0, 0.0), va="bottom", **behind, fontproperties=SMALL, annotation_clip=False, animated=True
    )
