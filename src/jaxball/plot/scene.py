"""The scene of an animation, a ball or a disk on its ground, one frame at a time."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as Ring, Polygon
from matplotlib.text import Text
from matplotlib.transforms import ScaledTranslation
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ..physics.grounds import AbstractSurface
from ..physics.state import DiskState
from ..simulation.trajectory import Trajectory
from .over_time import PATHS, Track, modes_of, track_of
from .palette import FAINT, INK, SHELL, TRAIL, mass_colour
from .record import Record, finite_rows
from .shapes import (
    BREAK,
    ROOM_AROUND,
    Floor,
    Placed,
    Setting,
    floor_under,
    ground_under,
    looks,
    on_surface,
    outline,
    parallel,
    place,
    rail_points,
    split,
    towards,
    wireframe,
)
from .style import CAPTION, SMALL_FONT, ShownFigure, describe_units, mass_line, subject, title_of
from .surface import Curve, Mesh, curve_under, mesh_under

ELEVATION_3D, AZIMUTH_3D = 26.0, -60.0  # degrees
SCENE_WIDTH, MARGIN, HEADER = 8.0, 0.15, 0.5  # inches
SHADOW = "0.88"
SPOKES = 12  # of a turntable
TOP, SIDE, TABLE = "0.965", "0.9", "0.93"
LIGHT = np.array([-0.28, -0.47, 0.84])  # towards it, from above and the left
EDGES = 0.06  # by which they are darker than its faces
DARKEST, BRIGHTEST = 0.78, 0.985  # greys of a surface
SHEER: dict[str, Any] = {"facecolor": "#9999991f", "edgecolor": "#99999959", "linewidth": 0.3}
GRID: dict[str, Any] = {"color": "0.88", "linewidth": 0.6, "zorder": 1}
BASELINE = -15.0  # of the clock, in points from the upper edge


def line(ax: Axes, animated: bool = True, **look) -> Line2D:
    """Makes a line that has no points yet."""
    empty = [[]] * (3 if isinstance(ax, Axes3D) else 2)
    return ax.plot(*empty, animated=animated, **look)[0]


def move(artist: Line2D, points: Float[np.ndarray, "points 3"]) -> None:
    """Moves a line to ``points``; in a plane figure, to their first and third coordinates."""
    if isinstance(artist.axes, Axes3D):
        artist.set_data_3d(*points.T)  # pyright: ignore[reportAttributeAccessIssue]
    else:
        artist.set_data(points[:, 0], points[:, 2])


def face(ax: Axes3D, edgecolor: str = "none", animated: bool = True, **look) -> Poly3DCollection:
    """Makes a polygon in space that has no corners yet."""
    polygon = Poly3DCollection([np.zeros((3, 3))], edgecolor=edgecolor, animated=animated, **look)
    ax.add_collection3d(polygon)
    return polygon


def draw_trail(
    ax: Axes, trajectory: Trajectory, placed: Placed, ground: Mesh | Curve | None = None, **look: Any
) -> Callable[[int], None]:
    """Draws the trail, on the ground if it is no plane; returns a function that shows it up to the k-th saved time."""
    if ground is not None:
        return _trail_on(ax, ground, trajectory, **look)
    track, setting = track_of(trajectory), placed.setting
    if track is None:
        trail = line(ax, color=TRAIL, **look)
        return lambda k: move(trail, placed.path[: k + 1] + setting.moved[k])
    look = {name: value for name, value in look.items() if name != "solid_capstyle"}
    pieces = [(track.pieces(mode), line(ax, color=TRAIL, **look, **dashes)) for mode, dashes in PATHS.items()]

    def show(k: int) -> None:
        for (times, points), artist in pieces:
            # A piece may have points after the time, at which it has not come yet.
            until = np.searchsorted(times, placed.times[k], side="right")
            move(artist, points[:until] @ setting.page.T + setting.moved[k])

    return show


def _trail_on(ax: Axes, ground: Mesh | Curve, trajectory: Trajectory, **look: Any) -> Callable[[int], None]:
    """Draws the trail over a surface: on the pieces that the body has touched, and above it where that flew."""
    modes, rows = modes_of(trajectory), finite_rows(trajectory)
    if not modes.spells:
        trail = line(ax, color=TRAIL, **look)
        return lambda k: move(trail, ground.trail(k))
    times, height = np.asarray(trajectory.times)[rows], np.asarray(trajectory.history.over_time["height"])[rows]
    between, lifted = modes.at((times[1:] + times[:-1]) / 2), ground.contacts.lift(height)
    lines = {mode: line(ax, color=TRAIL, **look, **dashes) for mode, dashes in PATHS.items()}

    def show(k: int) -> None:
        flown = ground.contacts.carry(lifted[: k + 1], k)
        points = np.where(height[: k + 1, None] > 0, flown, ground.trail(k))
        track = Track(times[: k + 1], points, between[:k])
        for mode, artist in lines.items():
            move(artist, track.pieces(mode)[1])

    return show


class Scene(NamedTuple):
    """A figure, and a function that makes it show the k-th saved time."""

    figure: Figure
    show: Callable[[int], None]


def scene(trajectory: Trajectory, run: Record) -> Scene:
    """Returns the scene of a ball in space, or of a disk in its plane; gravity points down."""
    make = _disk_scene if trajectory.system.planar else _ball_scene
    return make(trajectory, run, place(trajectory, run))


def _ball_scene(trajectory: Trajectory, run: Record, placed: Placed) -> Scene:
    setting, r = placed.setting, float(trajectory.system.radius)
    azimuth = placed.azimuth(AZIMUTH_3D)
    viewer = towards(ELEVATION_3D, azimuth)
    system, wire, silhouette = trajectory.system, wireframe(), outline(viewer)
    # Every eighth point of the silhouette is enough to find its extent.
    visited = (placed.centre[:, None] + r * silhouette[::8]).reshape(-1, 3)
    mesh = None
    surface = trajectory.system.ground
    if setting.contacts is None or not isinstance(surface, AbstractSurface):
        floor = floor_under(run.observables.contact_point, r, setting)
        figure, ax = stage(np.concatenate([floor.block.everywhere(setting.moved), visited]), azimuth)
        show_floor = draw_floor(ax, floor, setting, r, viewer)
    else:
        mesh = mesh_under(surface, placed.times, setting.contacts, r)
        figure, ax = stage(np.concatenate([mesh.everywhere(), visited]), azimuth)
        show_floor = draw_surface(ax, mesh, viewer)

    # A shadow below a ball that may leave the plane makes its height visible.
    shadow = face(ax, facecolor=SHADOW, zorder=1.5) if modes_of(trajectory).spells else None
    look: dict[str, Any] = {"linewidth": 1.8, "zorder": 2}
    show_trail = draw_trail(ax, trajectory, placed, mesh, **look)
    shade = face(ax, facecolor="white", alpha=0.7, zorder=3)
    back = line(ax, color=FAINT, linewidth=0.6, zorder=4)
    front = line(ax, color="0.6", linewidth=0.6, zorder=7)
    edge = line(ax, color=SHELL, linewidth=1.2, zorder=7)
    show_contents = _contents(figure, ax, trajectory, placed)

    def show(k: int) -> None:
        Lambda, rim = placed.Lambda[k], None
        near, far = split(wire @ Lambda.T, viewer)
        for artist, normals in ((front, near), (back, far), (edge, silhouette)):
            rim = placed.centre[k] + on_surface(system, normals @ Lambda) @ Lambda.T
            move(artist, rim)
        shade.set_verts([rim])
        if shadow is not None:
            rim = r * parallel(0.0)
            # On a surface the shadow lies in the tangent plane.
            under = placed.path[k] + setting.moved[k] + rim @ setting.page.T
            shadow.set_verts([under if setting.contacts is None else setting.contacts.lay(rim, k)])
        show_trail(k)
        show_floor(k)
        show_contents(k)

    return Scene(figure, show)


def stage(content: Float[np.ndarray, "points 3"], azimuth: float) -> tuple[Figure, Axes3D]:
    """Makes a figure that the points ``content`` fill, and its Axes, seen from ``azimuth``."""
    low, high = content.min(axis=0), content.max(axis=0)
    figure = ShownFigure(figsize=(SCENE_WIDTH, SCENE_WIDTH))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", computed_zorder=False)
    assert isinstance(ax, Axes3D)
    ax.set_proj_type("ortho")
    ax.view_init(elev=ELEVATION_3D, azim=azimuth)
    ax.set_axis_off()
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    # Less than the whole of the square Axes, beyond which the ends of a long box lie, and would be cut off.
    ax.set_box_aspect(tuple(high - low), zoom=0.75)  # pyright: ignore[reportArgumentType]
    # Drawn at a first scale, only to measure; the projection is parallel, so a larger one has the same proportions.
    x, y, _ = proj3d.proj_transform(*content.T, ax.get_proj())  # pyright: ignore[reportCallIssue]
    inches = ax.transData.transform(np.column_stack([x, y])) / figure.dpi
    (left, bottom), (width, height) = inches.min(axis=0), np.ptp(inches, axis=0)
    scale = min((SCENE_WIDTH - 2 * MARGIN) / width, (SCENE_WIDTH - MARGIN - HEADER) / height)
    tall = round(10 * (scale * height + MARGIN + HEADER)) / 10
    # The Axes stay square and extend beyond the figure, because they clip what is outside.
    corner = (SCENE_WIDTH - scale * width) / 2 - scale * left, MARGIN - scale * bottom
    side = scale * SCENE_WIDTH
    figure.set_size_inches(SCENE_WIDTH, tall)
    ax.set_position((corner[0] / SCENE_WIDTH, corner[1] / tall, side / SCENE_WIDTH, side / tall))
    return figure, ax


def _disk_scene(trajectory: Trajectory, run: Record, placed: Placed) -> Scene:
    setting, path, r = placed.setting, run.observables.contact_point, float(trajectory.system.radius)
    around = [placed.centre + aside for aside in ([-1.1 * r, 0.0, 0.0], [1.1 * r, 0.0, 0.0])]
    surface, curve = trajectory.system.ground, None
    if setting.contacts is not None and isinstance(surface, AbstractSurface):
        z = np.asarray(cast(DiskState, trajectory.state).z)[finite_rows(trajectory)]
        curve = curve_under(surface, placed.times, z, setting.contacts, r)
        around += [placed.centre + aside for aside in ([0.0, 0.0, -1.1 * r], [0.0, 0.0, 1.1 * r])]
    under = ground_under(path, r, setting).everywhere(setting.moved) if curve is None else curve.everywhere()
    content = np.concatenate([under, *around])
    (left, _, low), (right, _, high) = content.min(axis=0), content.max(axis=0)
    bottom, top = low - 0.25 * r, high + (1.55 * r if curve is None else 0.45 * r)
    # A disk that hardly moves, or goes far, would have a figure that is a tower or a line.
    height = np.clip(SCENE_WIDTH * (top - bottom) / (right - left), 2.0, 6.0)
    figure = ShownFigure(figsize=(SCENE_WIDTH, round(10 * float(height)) / 10))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(left, right), ylim=(bottom, top), aspect="equal")
    ax.set_axis_off()
    look: dict[str, Any] = {"linewidth": 3.0, "zorder": 2, "solid_capstyle": "butt"}
    if curve is None:
        show_ground = draw_ground(ax, path, r, setting)
        show_trail = draw_trail(ax, trajectory, placed, **look)
    else:
        show_ground, show_trail = draw_curve(ax, curve), _trail_on(ax, curve, trajectory, **look)
    shell = Ring((0.0, 0.0), r, facecolor="0.985", edgecolor=SHELL, linewidth=1.4, zorder=3, animated=True)
    ax.add_patch(shell)
    spokes = line(ax, color="0.75", linewidth=0.8, zorder=3)
    show_contents = _contents(figure, ax, trajectory, placed)

    def show(k: int) -> None:
        shell.set_center((placed.centre[k, 0], placed.centre[k, 2]))
        move(spokes, placed.centre[k] + _spokes(r) @ placed.Lambda[k].T)
        show_trail(k)
        show_ground(k)
        show_contents(k)

    return Scene(figure, show)


def _spokes(r: float) -> Float[np.ndarray, "points 3"]:
    """Returns a spoke along E1 and marks around the rim, as one curve with breaks."""
    gap = np.full(3, np.nan)
    points = [np.zeros(3), np.array([r, 0.0, 0.0]), gap]
    for angle in np.arange(1, 12) * np.pi / 6:
        n = np.array([np.cos(angle), 0.0, np.sin(angle)])
        points += [0.94 * r * n, r * n, gap]
    return np.stack(points)


def _contents(figure: Figure, ax: Axes, trajectory: Trajectory, placed: Placed) -> Callable[[int], None]:
    """Draws rails, masses, centre of mass and a clock, and returns a function that moves them to the k-th saved time.

    For a run with a law of contact, the clock shows the mode too.
    """
    system, modes = trajectory.system, modes_of(trajectory)
    named = [f"  {mode.name.lower()}" for mode in modes.at(placed.times)] if modes.spells else []
    words = named or [""] * len(placed.times)
    curves = ((i, rail_points(mass.motion, float(system.radius))) for i, mass in enumerate(system.point_masses, 1))
    rails = [(points, line(ax, **mass_line(i, linewidth=0.9, zorder=5))) for i, points in curves if points is not None]
    dot: dict[str, Any] = {"marker": "o", "ms": 8, "markeredgecolor": "white", "mew": 0.8, "linestyle": "none"}
    rods = [
        (points[:, i], line(ax, color=mass_colour(j), linewidth=1.4, zorder=5.5))
        for j, points in enumerate(placed.arms, start=system.n_masses + 1)
        for i in range(points.shape[1])
    ]
    shown = looks(system)
    names = [look.name if look not in shown[:k] else "" for k, look in enumerate(shown)]
    dots = [line(ax, **dot, color=look.colour, label=name, zorder=6) for look, name in zip(shown, names, strict=True)]
    star = line(ax, **(dot | {"marker": "*", "ms": 10}), color=INK, label="CM", zorder=6)
    figure.legend(
        loc="upper right", ncols=min(len(set(shown)) + 1, 7), frameon=False, prop=SMALL_FONT, handletextpad=0.2
    )
    show_clock = write_around(figure, ax, trajectory, placed.times, words)

    def show(k: int) -> None:
        centre, turn = placed.centre[k], placed.Lambda[k].T
        for points, artist in rails:
            move(artist, centre + points @ turn)
        for points, artist in rods:
            move(artist, centre + points[k] @ turn)
        for artist, point in zip(dots, placed.masses[k], strict=True):
            move(artist, centre + point[None])
        move(star, centre + placed.centre_of_mass[k][None])
        show_clock(k)

    return show


def write_around(
    figure: Figure, ax: Axes, trajectory: Trajectory, times: Float[np.ndarray, " T"], words: Sequence[str] = ()
) -> Callable[[int], None]:
    """Writes below a scene which system it shows, and above it the time; returns a function that changes it to the k-th
    of ``times``, with one of the ``words`` after it.
    """
    shown_system = subject(trajectory.system, title_of(trajectory), describe_units(trajectory))
    figure.text(0.5, 0.02 / figure.get_figheight(), shown_system, ha="center", va="bottom", **CAPTION)
    clock = _clock(figure, ax)

    def show(k: int) -> None:
        word = words[k] if words else ""
        clock.set_text(f"{times[k]:.2f}".replace("-", "\N{MINUS SIGN}") + word)

    return show


def _clock(figure: Figure, ax: Axes) -> Text:
    """Writes "t =" into the upper left corner, and returns the text after it, plain because formulas are slow."""
    corner = figure.transFigure + ScaledTranslation(0.0, BASELINE / 72, figure.dpi_scale_trans)
    name = figure.text(0.02, 1.0, "$t =$", fontproperties=SMALL_FONT, transform=corner)
    behind: dict[str, Any] = {"xycoords": name, "xytext": (2.5, 0.0), "textcoords": "offset points"}
    return ax.annotate(
        "", (1.0, 0.0), va="bottom", **behind, fontproperties=SMALL_FONT, annotation_clip=False, animated=True
    )


def draw_floor(
    ax: Axes3D, floor: Floor, setting: Setting, r: float, viewer: Float[np.ndarray, "3"]
) -> Callable[[int], None]:
    """Draws the floor, and returns a function that moves it to the k-th saved time.

    It has lines at every whole multiple of the radius, which a belt carries with it, or the turntable with rings there
    and with spokes, one darker.
    """
    top, base = floor.block
    moves = setting.moves
    faces = [(top, face(ax, facecolor=TOP, zorder=0, animated=moves))]
    if setting.tilted:
        # Only the sides that face the viewer: matplotlib does not hide what is behind something else.
        around = zip(top, np.roll(top, -1, axis=0), np.roll(base, -1, axis=0), base, strict=True)
        seen = (side for side in map(np.stack, around) if np.cross(side[1] - side[0], [0.0, 0.0, 1.0]) @ viewer > 0)
        faces += [(side, face(ax, facecolor=SIDE, zorder=0, animated=moves)) for side in seen]
    if setting.turned is None:
        marks = [(_grid(floor, r, np.zeros(2)), line(ax, **GRID, animated=moves))]
    else:
        rim = floor.table * parallel(0.0)
        faces.append((_turn_to_page(rim, floor, setting), face(ax, facecolor=TABLE, edgecolor="0.8", zorder=0.5)))
        rings = [np.concatenate([radius * parallel(0.0), BREAK]) for radius in multiples(r, r, floor.table)]
        spokes, mark = _table_spokes(floor.table)
        marks = [
            (np.concatenate([*rings, spokes]), line(ax, True, **(GRID | {"color": "0.82"}))),
            (mark, line(ax, True, **(GRID | {"color": SHELL, "linewidth": 1.4}))),
        ]

    def show(k: int) -> None:
        for corners, artist in faces:
            artist.set_verts([corners + setting.moved[k]])
        for points, artist in marks:
            points = points if setting.carried is None else _grid(floor, r, setting.carried[k])
            placed = points @ setting.page.T
            if setting.turned is not None:
                c, s = np.cos(setting.turned[k]), np.sin(setting.turned[k])
                turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
                placed = _turn_to_page(points @ turn.T, floor, setting)
            move(artist, placed + setting.moved[k])

    return show


def draw_surface(ax: Axes3D, mesh: Mesh, viewer: Float[np.ndarray, "3"]) -> Callable[[int], None]:
    """Draws a surface, and returns a function that moves it to the k-th saved time.

    Where the viewer sees the side of the ball, it is opaque and below the ball; elsewhere it is sheer and above it.
    """
    moves = mesh.contacts.moves
    below = face(ax, linewidth=0.3, zorder=0, animated=moves)
    above = face(ax, zorder=8, animated=moves, **SHEER)

    def show(k: int) -> None:
        # A surface at rest stays as it is drawn first.
        if k and not moves:
            return
        nodes = mesh.at(k)
        corners = np.stack([nodes[:-1, :-1], nodes[1:, :-1], nodes[1:, 1:], nodes[:-1, 1:]], axis=2).reshape(-1, 4, 3)
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        # A cell at an edge can have no area, and no normal.
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
        seen = normals @ viewer > 0
        greys = DARKEST + (BRIGHTEST - DARKEST) * np.clip(normals[seen] @ LIGHT, 0.0, 1.0)
        below.set_verts(list(corners[seen]))
        below.set_facecolor(np.repeat(greys[:, None], 3, axis=1))
        below.set_edgecolor(np.repeat(greys[:, None] - EDGES, 3, axis=1))
        above.set_verts(list(corners[~seen]))

    show(0)
    return show


def _turn_to_page(
    points: Float[np.ndarray, "points 3"], floor: Floor, setting: Setting
) -> Float[np.ndarray, "points 3"]:
    """Turns points given from the centre of the turntable into axes of the page."""
    return (points + setting.centre + [0.0, 0.0, floor.height]) @ setting.page.T


def _grid(floor: Floor, r: float, moved: Float[np.ndarray, "2"]) -> Float[np.ndarray, "points 3"]:
    """Returns the lines on the floor after they have moved, as one curve with breaks; space axes."""
    (x0, y0), (x1, y1), z = floor.low, floor.high, floor.height
    lines = [np.array([[x, y0, z], [x, y1, z]]) for x in multiples(r, x0, x1, moved[0])]
    lines += [np.array([[x0, y, z], [x1, y, z]]) for y in multiples(r, y0, y1, moved[1])]
    return np.concatenate([part for each in lines for part in (each, BREAK)])


def multiples(r: float, low: float, high: float, moved: float = 0.0) -> Float[np.ndarray, " n"]:
    """Returns the whole multiples of ``r`` from ``low`` to ``high``, or what they are after they have ``moved``."""
    return moved + r * np.arange(int(np.ceil((low - moved) / r)), int(np.floor((high - moved) / r)) + 1)


def _table_spokes(radius: float) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "2 3"]]:
    """Returns the spokes of a turntable as one curve with breaks, and the one that is darker."""
    angles = np.arange(SPOKES) * 2 * np.pi / SPOKES
    ends = radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    first, *others = (np.stack([np.zeros(3), end]) for end in ends)
    return np.concatenate([part for spoke in others for part in (spoke, BREAK)]), first


def draw_ground(ax: Axes, path: Float[np.ndarray, "T 3"], r: float, setting: Setting) -> Callable[[int], None]:
    """Draws the line under a disk, with marks at multiples of the radius; returns a function that moves it."""
    top, base = ground_under(path, r, setting)
    wedge = Polygon(np.zeros((3, 2)), facecolor=TOP, edgecolor="none", zorder=0, animated=setting.moves)
    if setting.tilted:
        ax.add_patch(wedge)
    surface = line(ax, color=SHELL, linewidth=1.2, zorder=1, animated=setting.moves)
    height = path[0, 2]
    ends = path[:, 0].min() - ROOM_AROUND * r, path[:, 0].max() + ROOM_AROUND * r

    def ticks(moved: float) -> Float[np.ndarray, "points 3"]:
        places = multiples(r, *ends, moved)
        each = [np.array([[x, 0.0, height - 0.06 * r], [x, 0.0, height], [np.nan] * 3]) for x in places]
        return np.concatenate(each) @ setting.page.T

    marks = line(ax, color=SHELL, linewidth=0.8, zorder=1, animated=setting.moves)

    def show(k: int) -> None:
        wedge.set_xy((np.concatenate([top, base[::-1]]) + setting.moved[k])[:, [0, 2]])
        move(surface, top + setting.moved[k])
        move(marks, ticks(0.0 if setting.carried is None else setting.carried[k, 0]) + setting.moved[k])

    return show


def draw_curve(ax: Axes, curve: Curve) -> Callable[[int], None]:
    """Draws the curve under a disk, and returns a function that moves it to the k-th saved time."""
    drawn = line(ax, color=SHELL, linewidth=1.2, zorder=1, animated=curve.contacts.moves)
    return lambda k: move(drawn, curve.at(k))
