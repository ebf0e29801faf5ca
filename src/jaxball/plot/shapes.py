"""What is drawn of a run, as points and curves: the parts of its body, and the ground under it in axes of the page.

Shell, rails, and mechanisms with their arms are in body axes. In the axes of the page, in which animations (``scene``)
and views (``view.rolling``) draw, gravity points down. A tilted plane is the top of a wedge. A moving plane carries its
floor, the body and the trail over the page. What is drawn of a surface is in :mod:`.surface`.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float
from mpl_toolkits.mplot3d import Axes3D

from .. import programs
from ..numerics.arrays import to_array
from ..physics.body import System
from ..physics.grounds import AbstractSurface
from ..physics.grounds.ground import Ground
from ..physics.prescribed.motion import AbstractMotion, rail_of
from ..physics.prescribed.rails import Tube
from ..physics.shape import AbstractShape
from ..simulation.trajectory import Trajectory
from .palette import mass_colour
from .record import Record, finite_rows
from .surface import Contacts, contacts_of

BREAK = np.full((1, 3), np.nan)

Curve = TypeVar("Curve")


def rail_points(motion: AbstractMotion, radius: float) -> Float[np.ndarray, "points 3"] | None:
    """Returns the rail of ``motion``: all of it if it is closed, the part inside the shell if it is a tube.

    None for a motion without a rail, and for an open rail of another family.
    """
    rail = rail_of(motion)
    if rail is None:
        return None
    if isinstance(rail, Tube):
        centre, direction = np.asarray(rail.centre), np.asarray(rail.direction)
        # Where the tube comes out of the shell: |centre + θ direction| = r, for a direction of length 1.
        along = centre @ direction / np.linalg.norm(direction)
        inside = along**2 - centre @ centre + radius**2  # the square of half the chord
        if not inside > 0:
            return None
        theta = -along + np.sqrt(inside) * np.array([-1.0, 1.0])
    elif rail.period is None:
        return None
    else:
        theta = np.linspace(0.0, rail.period, 241)
    return np.asarray(_points(rail, to_array(theta)))


@programs.filter_jit
def _points(rail, theta):
    return rail.points(theta)


def rails_of(system: System) -> list[tuple[list[int], Float[np.ndarray, "points 3"]]]:
    """Lists the rails that can be drawn, each with the masses i = 1 … n that are on it."""
    rails = ((i, rail_points(mass.motion, float(system.radius))) for i, mass in enumerate(system.point_masses, start=1))
    drawable = ((i, rail) for i, rail in rails if rail is not None)
    return group_equal(drawable, lambda rail, other: np.shape(other) == np.shape(rail) and np.allclose(other, rail))


def group_equal(
    curves: Iterable[tuple[int, Curve]], equal: Callable[[Curve, Curve], bool]
) -> list[tuple[list[int], Curve]]:
    """Lists the distinct curves, each with the masses i = 1 … n on it."""
    groups: list[tuple[list[int], Curve]] = []
    for i, curve in curves:
        for members, other in groups:
            if equal(curve, other):
                members.append(i)
                break
        else:
            groups.append(([i], curve))
    return groups


class Look(NamedTuple):
    """The name of a mass, and the number that determines its colour."""

    name: str
    number: int

    @property
    def colour(self) -> str:
        return mass_colour(self.number)


def looks(system: System) -> list[Look]:
    """Returns the look of each mass of a body: point masses m_i one by one, and the masses of a mechanism together as
    M_j.
    """
    shown = [Look(f"$m_{{{i}}}$", i) for i in range(1, system.n_masses + 1)]
    for j, mechanism in enumerate(system.mechanisms, start=1):
        shown += [Look(f"$M_{{{j}}}$", system.n_masses + j)] * mechanism.mass.shape[-1]
    return shown


def arms(prepared: Any, t: Float[Array, ""], theta: Float[Array, " coordinates"]) -> list[Float[Array, "n points 3"]]:
    """Returns, for each mechanism of a prepared system, the arms of its masses, body vectors from the centre;
    traceable.
    """
    places: dict[int, Array] = {}
    for group, order in zip(prepared.mechanism_groups, prepared.mechanism_order, strict=True):

        def one(mechanism, angles):
            return mechanism.arms(mechanism.rates(t, (angles, angles, angles))[0])

        group_arms = eqx.filter_vmap(one)(group, theta[prepared.slots(order, group.in_state)])
        places |= {index: group_arms[k] for k, index in enumerate(order)}
    return [places[index] for index in sorted(places)]


def on_surface(system: System, normals: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
    """Returns the points of a body's surface that have these outward normals, body axes; NaN for a break."""
    if system.shape is None:
        return float(system.radius) * normals
    return np.asarray(_points_with(system.shape, to_array(normals)))


@programs.filter_jit
def _points_with(shape: AbstractShape, normals: Float[Array, "points 3"]) -> Float[Array, "points 3"]:
    # A body stands where its outward normal points down.
    return -jax.vmap(shape.arm)(-normals)


def wireframe(meridians: int = 12, parallels: int = 5) -> Float[np.ndarray, "points 3"]:
    """Returns meridians and parallels of the unit sphere about the third axis, as one curve with breaks."""
    around = np.linspace(0.0, 2 * np.pi, 97)
    curves = []
    for azimuth in np.arange(meridians // 2) * 2 * np.pi / meridians:
        n = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        curves += [np.outer(np.sin(around), n) + np.outer(np.cos(around), [0.0, 0.0, 1.0]), BREAK]
    for height in np.linspace(-90, 90, parallels + 2)[1:-1]:
        curves += [parallel(np.deg2rad(height)), BREAK]
    return np.concatenate(curves)


def parallel(elevation: float) -> Float[np.ndarray, "97 3"]:
    """Returns the parallel of the unit sphere at ``elevation``, in radians."""
    around = np.linspace(0.0, 2 * np.pi, 97)
    flat = np.cos(elevation) * np.stack([np.cos(around), np.sin(around)], axis=1)
    return np.column_stack([flat, np.full_like(around, np.sin(elevation))])


def view(ax: Axes3D) -> Float[np.ndarray, "3"]:
    """Returns the unit vector towards the viewer of ``ax``."""
    return towards(float(ax.elev), float(ax.azim))


def towards(elevation: float, azimuth: float) -> Float[np.ndarray, "3"]:
    """Returns the unit vector towards a viewer at these angles, in degrees."""
    e, a = np.deg2rad(elevation), np.deg2rad(azimuth)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def outline(viewer: Float[np.ndarray, "3"]) -> Float[np.ndarray, "97 3"]:
    """Returns the circle of the normals that a silhouette has for a distant viewer in the direction ``viewer``."""
    across = np.cross([0.0, 0.0, 1.0] if abs(viewer[2]) < 0.9 else [1.0, 0.0, 0.0], viewer)
    across /= np.linalg.norm(across)
    around = np.linspace(0.0, 2 * np.pi, 97)
    return np.outer(np.cos(around), across) + np.outer(np.sin(around), np.cross(viewer, across))


def split(
    points: Float[np.ndarray, "points 3"], viewer: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
    """Returns the half of the unit sphere's curves that faces the viewer, and the half behind; NaN elsewhere."""
    depth = (points @ viewer)[:, None]
    return np.where(depth >= 0, points, np.nan), np.where(depth <= 0, points, np.nan)


ROOM_AROUND = 1.3  # from the path to the edge of the floor, in radii
WIDTH_OF_ROUND = 0.7  # of its length, the width from which on a path has no direction
LEAST_MOVED = 1e-9


class Setting(NamedTuple):
    """Where the ground is on the page at every saved time; the third axis of the page points against gravity."""

    page: Float[np.ndarray, "3 3"]  # from space axes to those of the page
    moved: Float[np.ndarray, "T 3"]  # the displacement X of the plane, axes of the page
    turned: Float[np.ndarray, " T"] | None  # the angle of the turntable, if there is one
    centre: Float[np.ndarray, "3"]  # about which it turns, space axes
    contacts: Contacts | None = None  # with a surface
    carried: Float[np.ndarray, "T 2"] | None = None  # how far the belt has moved, if there is one; space axes

    @property
    def tilted(self) -> bool:
        return bool(self.page[2, 2] < 1)

    @property
    def moves(self) -> bool:
        """Whether the ground is displaced or turned during the run."""
        if self.contacts is not None:
            return self.contacts.moves
        carried = self.turned is not None or self.carried is not None
        return carried or bool(np.ptp(self.moved, axis=0).any())

    @property
    def downhill(self) -> float:
        """The direction of steepest descent on the page, in degrees; 0 where the plane is level."""
        return float(np.rad2deg(np.arctan2(self.page[1, 2], self.page[0, 2]))) if self.tilted else 0.0


class Placed(NamedTuple):
    """The motion of the bodies of a scene on the page."""

    times: Float[np.ndarray, " T"]
    setting: Setting
    Lambda: Float[np.ndarray, "T 3 3"]  # from body axes to those of the page
    centre: Float[np.ndarray, "T 3"]  # of the shell
    masses: Float[np.ndarray, "T n 3"]  # from the centre
    centre_of_mass: Float[np.ndarray, "T 3"]  # from the centre
    path: Float[np.ndarray, "T 3"]  # of the contact point on the ground, without the ground's motion
    arms: list[Float[np.ndarray, "T n points 3"]]  # of each mechanism, body vectors from the centre

    def azimuth(self, otherwise: float) -> float:
        """Returns the direction from which a ball is seen, in degrees: a surface from ``otherwise``, a slope from there
        beside its descent, so that it is visible, and a level plane from the side of the path, which leads to the
        right: one that falls or rises on the page looks like a slope. So does the floor of a round path, whose edges
        are seen level.
        """
        if self.setting.tilted or self.setting.contacts is not None:
            return otherwise + self.setting.downhill
        moved = self.path[:, :2] - self.path[:, :2].mean(axis=0)
        sizes, directions = np.linalg.svd(moved, full_matrices=False)[1:]
        along, extent = directions[0], float(np.max(np.abs(moved), initial=0.0))
        # Round paths have no side, and one that is short beside its distance from the origin is a point.
        if sizes[-1] > WIDTH_OF_ROUND * sizes[0] or extent <= LEAST_MOVED * (1 + np.max(np.abs(self.path))):
            along = np.array([1.0, 0.0])
        elif along @ (self.path[-1] - self.path[0])[:2] < 0:
            along = -along
        return float(np.rad2deg(np.arctan2(along[1], along[0]))) - 90.0


def place(trajectory: Trajectory, run: Record) -> Placed:
    """Expresses a run in the axes of the page."""
    rows, seen, system = finite_rows(trajectory), run.observables, trajectory.system
    plane = system.ground if isinstance(system.ground, Ground) else None
    with_arms, state = system if system.mechanisms else None, jax.tree.map(lambda leaf: leaf[rows], trajectory.state)
    seen_at = _evaluate(plane, with_arms, to_array(run.times), state)
    Lambda, arms, moved, turned, carried = jax.tree.map(np.asarray, seen_at)
    if isinstance(system.ground, AbstractSurface):
        contacts = contacts_of(system.ground, run.times, np.asarray(state.z), np.asarray(state.theta))
        setting = Setting(np.eye(3), contacts.moved, None, np.zeros(3), contacts)
    else:
        setting = _on_plane(plane, moved, turned, carried, len(rows))
    page, contacts = setting.page, setting.contacts
    return Placed(
        times=run.times,
        setting=setting,
        Lambda=page @ Lambda,
        centre=seen.geometric_centre @ page.T + (setting.moved if contacts is None else 0.0),
        masses=seen.mass_positions_space @ page.T,
        centre_of_mass=seen.centre_of_mass_space @ page.T,
        path=seen.contact_point @ page.T if contacts is None else contacts.points,
        arms=arms,
    )


def _on_plane(
    plane: Ground | None,
    moved: Float[np.ndarray, "T 3"] | None,
    turned: Float[np.ndarray, " T"] | None,
    carried: Float[np.ndarray, "T 2"] | None,
    count: int,
) -> Setting:
    """Returns the setting of a plane, from its displacement in space axes."""
    up = np.array([0.0, 0.0, 1.0]) if plane is None else np.asarray(plane.up())
    tilt = np.array([[0.0, 0.0, -up[0]], [0.0, 0.0, -up[1]], [up[0], up[1], 0.0]])
    # Rodrigues' formula; a plane is tilted by less than 90°, so 1 + up₃ is not 0.
    page = np.eye(3) + tilt + tilt @ tilt / (1 + up[2])  # turns about a horizontal axis, and takes ``up`` to e3
    displacement = np.zeros((count, 3)) if moved is None else moved @ page.T
    table = None if plane is None else plane.turntable
    centre = (0.0, 0.0) if table is None else np.asarray(table.centre)
    return Setting(page, displacement, turned, np.array([*centre, 0.0]), carried=carried)


@programs.filter_jit
def _evaluate(ground, system, times, states):
    """Computes Λ, the arms, X, the angle of the turntable and the way of the belt at each time; None for what the
    ground lacks.
    """
    ground, system = (None if part is None else part.prepare() for part in (ground, system))

    def at_time(t, state):
        moved = None if ground is None or ground.motion is None else ground.motion.kinematics(t).chi
        table = None if ground is None else ground.turntable
        turned = None if table is None else table.turning.derivatives(t)[0]
        belt = None if ground is None else ground.belt
        carried = None if belt is None else belt.travel.derivatives(t)[0] * belt.direction
        rods = [] if system is None else arms(system, t, state.theta)
        return state.in_space().Lambda, rods, moved, turned, carried

    return jax.vmap(at_time)(times, states)


class Block(NamedTuple):
    """The corners of the floor, counterclockwise from above, and below them those of the wedge; axes of the page."""

    top: Float[np.ndarray, "corners 3"]
    base: Float[np.ndarray, "corners 3"]

    def everywhere(self, moved: Float[np.ndarray, "T 3"]) -> Float[np.ndarray, "points 3"]:
        """Returns the corners at the extremes of the plane's displacement."""
        corners = np.concatenate([self.top, self.base])
        # Corners of the box of all displacements, instead of a copy for each time.
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
    """Returns the floor under a ``path`` of the contact point, space axes."""
    along, height, table = path[:, :2], float(path[0, 2]), 0.0
    low, high = along.min(axis=0) - ROOM_AROUND * r, along.max(axis=0) + ROOM_AROUND * r
    if setting.turned is not None:
        centre = setting.centre[:2]
        # The whole table is shown, because it turns.
        table = float(np.max(np.linalg.norm(along - centre, axis=1))) + ROOM_AROUND * r
        low, high = np.minimum(low, centre - table), np.maximum(high, centre + table)
    xs, ys = (low[0], high[0], high[0], low[0]), (low[1], low[1], high[1], high[1])
    return Floor(low, high, height, table, _block(np.column_stack([xs, ys, np.full(4, height)]), setting))


def ground_under(path: Float[np.ndarray, "T 3"], r: float, setting: Setting) -> Block:
    """Returns the line under a disk, whose contact point has the ``path``, space axes: from left to right."""
    ends = path[:, 0].min() - ROOM_AROUND * r, path[:, 0].max() + ROOM_AROUND * r
    return _block(np.array([[end, 0.0, path[0, 2]] for end in ends]), setting)
