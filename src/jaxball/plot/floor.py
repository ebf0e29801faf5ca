"""Where a run is on the page, on which gravity points down: its ground, its bodies and the floor under them.

A tilted plane is the top of a wedge. A moving plane carries its floor, the body and the trail over the page.
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..numerics import programs
from ..numerics.arrays import to_array
from ..physics.body import System
from .record import Record

ROOM = 1.3  # from the path to the edge of the floor, in radii


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


def ground_under(path: Float[np.ndarray, "T 3"], r: float, setting: Setting) -> Block:
    """The line under a disk, whose contact point has the ``path``, space axes: from left to right."""
    ends = path[:, 0].min() - ROOM * r, path[:, 0].max() + ROOM * r
    return _block(np.array([[end, 0.0, path[0, 2]] for end in ends]), setting)
