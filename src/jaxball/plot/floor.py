"""The ground of an animation: a page on which gravity points down, and a floor that moves and turns like the ground.

A tilted plane is the top of a wedge. A moving plane carries its floor, the body and the trail over the page.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from mpl_toolkits.mplot3d import Axes3D

from ..numerics import programs
from ..numerics.arrays import to_array
from ..physics.body import System
from .moving import face, line, move
from .palette import SHELL
from .record import Record
from .shapes import BREAK

SPOKES = 12  # of a turntable
ROOM = 1.3  # from the path to the edge of the floor, in radii
TOP, SIDE, TABLE = "0.965", "0.9", "0.93"
GRID: dict[str, Any] = {"color": "0.88", "linewidth": 0.6, "zorder": 1}


class Setting(NamedTuple):
    """Where the ground is on the page at every saved time; the third axis of the page points against gravity."""

    page: Float[np.ndarray, "3 3"]  # from space axes to those of the page
    moved: Float[np.ndarray, "T 3"]  # the displacement X of the plane, axes of the page
    turned: Float[np.ndarray, " T"] | None  # the angle of the turntable, if there is one
    centre: Float[np.ndarray, "3"]  # about which it turns, space axes

    @property
    def tilted(self) -> bool:
        return bool(self.page[2, 2] < 1)

    @property
    def moves(self) -> bool:
        """Whether the ground is displaced or turned during the run."""
        return self.turned is not None or bool(np.ptp(self.moved, axis=0).any())

    @property
    def downhill(self) -> float:
        """The direction of steepest descent on the page, in degrees; 0 where the plane is level."""
        return float(np.rad2deg(np.arctan2(self.page[1, 2], self.page[0, 2]))) if self.tilted else 0.0


class Placed(NamedTuple):
    """The motion of the bodies of a scene on the page."""

    times: Float[np.ndarray, " T"]
    Lambda: Float[np.ndarray, "T 3 3"]  # from body axes to those of the page
    centre: Float[np.ndarray, "T 3"]  # of the shell
    masses: Float[np.ndarray, "T n 3"]  # from the centre
    centre_of_mass: Float[np.ndarray, "T 3"]  # from the centre
    path: Float[np.ndarray, "T 3"]  # of the contact point on the plane, without the plane's displacement
    moved: Float[np.ndarray, "T 3"]


def setting_of(system: System, times: Float[np.ndarray, " T"]) -> Setting:
    """The setting of a run."""
    ground, still = system.ground, np.zeros((len(times), 3))
    if ground is None:
        return Setting(np.eye(3), still, None, np.zeros(3))
    page = _upright(np.asarray(ground.up()))
    moved, turned = _motion(ground, to_array(times))
    centre = np.zeros(2) if ground.turntable is None else np.asarray(ground.turntable.centre)
    return Setting(
        page,
        still if moved is None else np.asarray(moved) @ page.T,
        None if turned is None else np.asarray(turned),
        np.array([*centre, 0.0]),
    )


def place(run: Record, setting: Setting) -> Placed:
    """A run in the axes of the page."""
    seen, turn = run.observables, setting.page.T
    return Placed(
        run.times,
        setting.page @ run.Lambda,
        seen.geometric_centre @ turn + setting.moved,
        seen.mass_positions_space @ turn,
        seen.centre_of_mass_space @ turn,
        seen.contact_point @ turn,
        setting.moved,
    )


def _upright(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation about a horizontal axis that takes the unit vector ``up`` to e3."""
    tilt = np.array([[0.0, 0.0, -up[0]], [0.0, 0.0, -up[1]], [up[0], up[1], 0.0]])
    return np.eye(3) + tilt + tilt @ tilt / (1 + up[2])


@programs.filter_jit
def _motion(ground, times):
    """X and the angle of the turntable at each time; None for what the ground lacks."""
    ground = ground.prepare()
    moved = None if ground.motion is None else jax.vmap(lambda t: ground.motion.kinematics(t).chi)(times)
    table = ground.turntable
    turned = None if table is None else jax.vmap(lambda t: table.turning.derivatives(t)[0])(times)
    return moved, turned


class Block(NamedTuple):
    """The corners of the floor, counterclockwise from above, and below them those of the wedge; axes of the page."""

    top: Float[np.ndarray, "corners 3"]
    base: Float[np.ndarray, "corners 3"]

    def everywhere(self, moved: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "points 3"]:
        """The corners at the extremes of the plane's displacement."""
        corners = np.concatenate([self.top, self.base])
        ends = np.stack(np.meshgrid(*np.stack([moved.min(axis=0), moved.max(axis=0)], axis=1), indexing="ij"), axis=-1)
        return (corners[:, None] + ends.reshape(-1, 3)).reshape(-1, 3)


def _block(corners: Float[np.ndarray, "corners 3"], setting: Setting) -> Block:
    top = corners @ setting.page.T
    return Block(top, np.column_stack([top[:, :2], np.full(len(top), top[:, 2].min())]))


class Floor(NamedTuple):
    """The plane under a ball: a rectangle around its path, or around its turntable; space axes."""

    low: Float[np.ndarray, "2"]
    high: Float[np.ndarray, "2"]
    height: float
    table: float  # the radius of the turntable, 0 without one
    block: Block


def floor_under(path: Float[np.ndarray, "T 3"], r: float, setting: Setting) -> Floor:
    """The floor under a ``path`` of the contact point, space axes."""
    along, height, table = path[:, :2], float(path[0, 2]), 0.0
    low, high = along.min(axis=0) - ROOM * r, along.max(axis=0) + ROOM * r
    if setting.turned is not None:
        centre = setting.centre[:2]
        table = float(np.max(np.linalg.norm(along - centre, axis=1))) + ROOM * r
        low, high = np.minimum(low, centre - table), np.maximum(high, centre + table)
    xs, ys = (low[0], high[0], high[0], low[0]), (low[1], low[1], high[1], high[1])
    return Floor(low, high, height, table, _block(np.column_stack([xs, ys, np.full(4, height)]), setting))


def draw_floor(
    ax: Axes3D, floor: Floor, setting: Setting, r: float, viewer: Float[np.ndarray, "3"]
) -> Callable[[int], None]:
    """Draws the floor, and returns a function that moves it to the k-th saved time.

    It has lines at every whole multiple of the radius, or the turntable with rings there and with spokes, one darker.
    """
    top, base = floor.block
    moves = setting.moves
    faces = [(top, face(ax, facecolor=TOP, zorder=0, animated=moves))]
    if setting.tilted:
        around = zip(top, np.roll(top, -1, axis=0), np.roll(base, -1, axis=0), base, strict=True)
        seen = (side for side in map(np.stack, around) if np.cross(side[1] - side[0], [0.0, 0.0, 1.0]) @ viewer > 0)
        faces += [(side, face(ax, facecolor=SIDE, zorder=0, animated=moves)) for side in seen]
    if setting.turned is None:
        marks = [(_grid(floor, r), line(ax, **GRID, animated=moves))]
    else:
        rim = _circle(floor.table)
        faces.append((_seated(rim, floor, setting), face(ax, facecolor=TABLE, edgecolor="0.8", zorder=0.5)))
        rings = [np.concatenate([_circle(radius), BREAK]) for radius in multiples(r, r, floor.table)]
        spokes, mark = _spokes(floor.table)
        marks = [
            (np.concatenate([*rings, spokes]), line(ax, True, **(GRID | {"color": "0.82"}))),
            (mark, line(ax, True, **(GRID | {"color": SHELL, "linewidth": 1.4}))),
        ]

    def show(k: int) -> None:
        for corners, artist in faces:
            artist.set_verts([corners + setting.moved[k]])
        for points, artist in marks:
            placed = points @ setting.page.T
            if setting.turned is not None:
                c, s = np.cos(setting.turned[k]), np.sin(setting.turned[k])
                turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
                placed = _seated(points @ turn.T, floor, setting)
            move(artist, placed + setting.moved[k])

    return show


def _seated(points: Float[np.ndarray, "points 3"], floor: Floor, setting: Setting) -> Float[np.ndarray, "points 3"]:
    """Points given from the centre of the turntable, in axes of the page."""
    return (points + setting.centre + [0.0, 0.0, floor.height]) @ setting.page.T


def _grid(floor: Floor, r: float) -> Float[np.ndarray, "points 3"]:
    """The lines on the floor, as one curve with breaks; space axes."""
    (x0, y0), (x1, y1), z = floor.low, floor.high, floor.height
    lines = [np.array([[x, y0, z], [x, y1, z]]) for x in multiples(r, x0, x1)]
    lines += [np.array([[x0, y, z], [x1, y, z]]) for y in multiples(r, y0, y1)]
    return np.concatenate([part for each in lines for part in (each, BREAK)])


def multiples(r: float, low: float, high: float) -> Float[np.ndarray, " n"]:
    """The whole multiples of ``r`` from ``low`` to ``high``."""
    return r * np.arange(int(np.ceil(low / r)), int(np.floor(high / r)) + 1)


def _circle(radius: float) -> Float[np.ndarray, "97 3"]:
    around = np.linspace(0.0, 2 * np.pi, 97)
    return radius * np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)


def _spokes(radius: float) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "2 3"]]:
    """The spokes of a turntable as one curve with breaks, and the one that is darker."""
    angles = np.arange(SPOKES) * 2 * np.pi / SPOKES
    ends = radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    first, *others = (np.stack([np.zeros(3), end]) for end in ends)
    return np.concatenate([part for spoke in others for part in (spoke, BREAK)]), first


def ground_under(path: Float[np.ndarray, "T 3"], r: float, setting: Setting) -> Block:
    """The line under a disk, whose contact point has the ``path``, space axes: from left to right."""
    ends = path[:, 0].min() - ROOM * r, path[:, 0].max() + ROOM * r
    return _block(np.array([[end, 0.0, path[0, 2]] for end in ends]), setting)


def draw_ground(ax: Axes, path: Float[np.ndarray, "T 3"], r: float, setting: Setting) -> Callable[[int], None]:
    """Draws the line under a disk, with marks at multiples of the radius; returns a function that moves it."""
    top, base = ground_under(path, r, setting)
    wedge = Polygon(np.zeros((3, 2)), facecolor=TOP, edgecolor="none", zorder=0, animated=setting.moves)
    if setting.tilted:
        ax.add_patch(wedge)
    surface = line(ax, color=SHELL, linewidth=1.2, zorder=1, animated=setting.moves)
    height = path[0, 2]
    at = multiples(r, path[:, 0].min() - ROOM * r, path[:, 0].max() + ROOM * r)
    ticks = [np.array([[x, 0.0, height - 0.06 * r], [x, 0.0, height], [np.nan] * 3]) @ setting.page.T for x in at]
    marks = line(ax, color=SHELL, linewidth=0.8, zorder=1, animated=setting.moves)

    def show(k: int) -> None:
        wedge.set_xy((np.concatenate([top, base[::-1]]) + setting.moved[k])[:, [0, 2]])
        move(surface, top + setting.moved[k])
        move(marks, np.concatenate(ticks) + setting.moved[k])

    return show
