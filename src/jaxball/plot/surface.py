"""A ground that is a surface, for animations and views: its motion, the contact points, and a mesh near them.

The page has the axes of space. A mesh and the contact points are in axes that the surface's motion carries; the mesh of
a ground that also changes its form differs from one time to the next.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.ndimage import distance_transform_edt

from .. import programs
from ..numerics.arrays import to_array
from ..numerics.vectors import apply, cross, unit_vector
from ..physics.grounds import AbstractSurface, Bowl, Cylinder, MovingFrame, SignedDistance, SphereOutside

ROOM = 1.6  # from the path to the edge of the mesh, in radii
CLOSE = 0.02  # radii, the allowed distance of the surface from the lines of the mesh
POINTS = 721  # points of the section under a disk
FINEST, COARSEST = 120, 12  # cells of the mesh in each direction
BEND = 1.5  # rad from the lowest or highest point of a sphere, beyond which a mesh of it need not go
TOP = 0.98 * np.pi  # rad, where the coordinates of a sphere are not yet too large


class Contacts(NamedTuple):
    """Where a body touches a surface at the saved times, and where the surface is."""

    coordinates: Float[np.ndarray, "T 2"]
    points: Float[np.ndarray, "T 3"]  # axes that move with the surface
    normals: Float[np.ndarray, "T 3"]  # space axes
    slopes: Float[np.ndarray, "T 2 3"]  # ∂p/∂u1 and ∂p/∂u2, of a disk along its section and across, space axes
    turns: Float[np.ndarray, "T 3 3"]  # from axes that move with the surface to those of space
    moved: Float[np.ndarray, "T 3"]  # of their origin
    deforms: bool

    def carry(self, points: Float[np.ndarray, "points 3"], k: int) -> Float[np.ndarray, "points 3"]:
        """Returns where points that move with the surface are at the k-th time."""
        return points @ self.turns[k].T + self.moved[k]

    def lift(self, height: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T 3"]:
        """Returns points at a height above the contact points, axes that move with the surface."""
        return self.points + height[:, None] * np.einsum("kij,ki->kj", self.turns, self.normals)

    def lay(self, points: Float[np.ndarray, "points 3"], k: int) -> Float[np.ndarray, "points 3"]:
        """Moves points of a plane into the plane that touches the surface at the k-th time, space axes."""
        first, normal = self.tangents[k], self.normals[k]
        return self.feet[k] + points @ np.stack([first, np.cross(normal, first), normal])

    @property
    def lengths(self) -> Float[np.ndarray, "T 2"]:
        """|∂p/∂u| by each coordinate."""
        return np.linalg.norm(self.slopes, axis=2)

    @property
    def tangents(self) -> Float[np.ndarray, "T 3"]:
        """The unit vectors along ∂p/∂u1, or along the section of a disk."""
        return self.slopes[:, 0] / self.lengths[:, :1]

    @property
    def feet(self) -> Float[np.ndarray, "T 3"]:
        """The contact points, space axes."""
        return np.einsum("kij,kj->ki", self.turns, self.points) + self.moved

    @property
    def moves(self) -> bool:
        return self.deforms or bool(np.ptp(self.turns, axis=0).any() or np.ptp(self.moved, axis=0).any())


class Mesh(NamedTuple):
    """Points of a surface at the nodes of a grid, in axes that move with it: the same at all times, or at each."""

    points: Float[np.ndarray, "S rows columns 3"]
    grid: Float[np.ndarray, "rows columns 2"]
    contacts: Contacts

    def at(self, k: int) -> Float[np.ndarray, "rows columns 3"]:
        """Returns where the nodes are at the k-th time, space axes."""
        points = self.points[k if len(self.points) > 1 else 0]
        return self.contacts.carry(points.reshape(-1, 3), k).reshape(points.shape)

    def trail(self, k: int) -> Float[np.ndarray, "points 3"]:
        """Returns the pieces of the ground that the ball has touched until the k-th time, where they are then, space
        axes.
        """
        if len(self.points) == 1:
            return self.contacts.carry(self.contacts.points[: k + 1], k)
        place, points = nodes(self.grid, self.contacts.coordinates[: k + 1]), self.at(k)
        # Bilinear within the cell; the last node belongs to the cell before it.
        i, j = (
            np.minimum(np.floor(share).astype(int), size - 2)
            for share, size in zip(place.T, points.shape, strict=False)
        )
        s, t = (place - np.stack([i, j], axis=1)).T[:, :, None]
        near, far = ((1 - t) * points[p, j] + t * points[p, j + 1] for p in (i, i + 1))
        return (1 - s) * near + s * far

    def everywhere(self) -> Float[np.ndarray, "points 3"]:
        """Returns where the nodes come during the run; for a long one, at some of its times."""
        return np.concatenate([self.at(k).reshape(-1, 3) for k in _some_times(self.contacts)])


class Curve(NamedTuple):
    """Points of the section of a surface along which a disk rolls, in axes that move with it, at one time or at each.

    ``along`` are the coordinates of the points, and ``z`` those of the disk.
    """

    points: Float[np.ndarray, "S points 3"]
    along: Float[np.ndarray, " points"]
    z: Float[np.ndarray, " T"]
    contacts: Contacts

    def at(self, k: int) -> Float[np.ndarray, "points 3"]:
        """Returns where the points are at the k-th time, space axes."""
        return self.contacts.carry(self.points[k if len(self.points) > 1 else 0], k)

    def trail(self, k: int) -> Float[np.ndarray, "points 3"]:
        """Returns the pieces of the ground that the disk has touched until the k-th time, where they are then, space
        axes.
        """
        points = self.at(k)
        return np.stack([np.interp(self.z[: k + 1], self.along, column) for column in points.T], axis=1)

    def everywhere(self) -> Float[np.ndarray, "points 3"]:
        """Returns where the points come during the run; for a long one, at some of its times."""
        return np.concatenate([self.at(k) for k in _some_times(self.contacts)])


def _some_times(contacts: Contacts) -> list[int]:
    """Returns the indices of a few saved times, of one where the ground is at rest."""
    return np.unique(np.linspace(0, len(contacts.moved) - 1, 40 if contacts.moves else 1).astype(int)).tolist()


def contacts_of(
    surface: AbstractSurface,
    times: Float[np.ndarray, " T"],
    coordinates: Float[np.ndarray, "T *two"],
    theta: Float[np.ndarray, "T coordinates"] | None = None,
) -> Contacts:
    """Computes the contact points with these coordinates, both of a ball or the only one for a disk, at the saved
    times.

    ``theta`` is that of the states, for a ground that a law drives; without it the ground is not driven.
    """
    theta = np.zeros((len(times), len(surface.driven))) if theta is None else theta
    arguments = surface, to_array(times), to_array(coordinates), to_array(theta)
    *fields, rate = map(np.asarray, _compute_contacts(*arguments))
    return Contacts(*fields, deforms=bool(np.any(rate != 0)))


@programs.filter_jit
def _compute_contacts(surface: AbstractSurface, times: Any, coordinates: Any, theta: Any) -> tuple[Any, ...]:
    """Computes the arrays of :class:`Contacts` after the coordinates, and the matter's speed in the surface's axes."""
    prepared = surface.prepare()

    def at_time(t, u, theta):
        angles = theta[theta.shape[0] - len(prepared.driven) :]
        surface = prepared.following(t, angles, 0.0 * angles, 0.0 * angles)
        frame = MovingFrame() if surface.motion is None else surface.motion

        def rates(function, x):
            return jax.jvp(function, (x,), (jnp.ones_like(x),))

        both = surface.coordinates(u)
        point, rate = rates(lambda x: surface.point(x, both[0], both[1]), t)
        _, first = rates(lambda x: surface.point(t, x, both[1]), both[0])
        _, second = rates(lambda x: surface.point(t, both[0], x), both[1])
        normal = unit_vector(cross(first, second))
        if not u.ndim:
            _, first = rates(lambda x: surface.point(t, *surface.section(x)), u)
            second = cross(normal, first)
        # The motion of the frame takes points to points: its origin and three unit points give the rotation.
        corners = jnp.concatenate([jnp.zeros((1, 3), t.dtype), jnp.eye(3, dtype=t.dtype)])
        corners = jax.vmap(lambda x: frame.place(t, x))(corners)
        turn = (corners[1:] - corners[:1]).T
        slopes = jnp.stack([apply(turn, first), apply(turn, second)])
        return both, point, apply(turn, normal), slopes, turn, corners[0], rate

    return jax.vmap(at_time)(times, coordinates, theta)


def nodes(grid: Float[np.ndarray, "rows columns 2"], coordinates: Float[np.ndarray, "T 2"]) -> Float[np.ndarray, "T 2"]:
    """Returns the row and the column of a rectangular grid at which coordinates are, between whole numbers."""
    low, high = grid[0, 0], grid[-1, -1]
    return np.clip((coordinates - low) / (high - low), 0.0, 1.0) * (np.array(grid.shape[:2]) - 1)


def mesh_under(surface: AbstractSurface, times: Float[np.ndarray, " T"], contacts: Contacts, r: float) -> Mesh:
    """Builds the mesh under the path of a ball of radius ``r``."""
    grid = mesh_grid(surface, [contacts], times, r)
    return Mesh(mesh_points(surface, times if contacts.deforms else times[:1], grid), grid, contacts)


def mesh_grid(
    surface: AbstractSurface, every: Sequence[Contacts], times: Float[np.ndarray, " T"], r: float
) -> Float[np.ndarray, "rows columns 2"]:
    """Returns the coordinates of the nodes of a mesh under all paths; ``times`` belong to the first of them.

    It is as coarse as keeps its lines within ``CLOSE`` of the surface.
    """
    fine = _part(surface, every, r)
    # A form that changes is looked at five times for the size of its cells.
    some = np.unique(np.linspace(0, len(times) - 1, 5 if every[0].deforms else 1).astype(int))
    points = mesh_points(surface, times[some], fine)
    rows, columns = (_step(np.moveaxis(points, axis, 1).reshape(len(some), FINEST + 1, -1, 3), r) for axis in (1, 2))
    return fine[::rows, ::columns]


def mesh_points(
    surface: AbstractSurface, times: Float[np.ndarray, " S"], grid: Float[np.ndarray, "rows columns 2"]
) -> Float[np.ndarray, "S rows columns 3"]:
    """Computes the nodes of a mesh at each time, in axes that move with the surface.

    Where the surface has no such piece, a node is on one next to it that exists, so that cells end at the edge.
    """
    points = np.asarray(_points(surface, to_array(times), to_array(grid)))
    return points if np.all(np.isfinite(points)) else np.stack([_close_gaps(nodes) for nodes in points])


def _close_gaps(points: Float[np.ndarray, "rows columns 3"]) -> Float[np.ndarray, "rows columns 3"]:
    """Replaces points that are not finite by the nearest finite ones, by rows and columns."""
    missing = ~np.all(np.isfinite(points), axis=-1)
    if not np.any(missing) or np.all(missing):
        return points
    # Cells then have corners on the edge, and end there.
    nearest = np.asarray(distance_transform_edt(missing, return_distances=False, return_indices=True))
    return points[nearest[0], nearest[1]]


@programs.filter_jit
def _points(surface: AbstractSurface, times: Any, grid: Any) -> Any:
    surface = surface.prepare()

    def at_time(t):
        nodes = jax.vmap(lambda u: surface.point(t, u[0], u[1]))(grid.reshape(-1, 2))
        return nodes.reshape((*grid.shape[:2], 3))

    return jax.vmap(at_time)(times)


def curve_under(
    surface: AbstractSurface, times: Float[np.ndarray, " T"], z: Float[np.ndarray, " T"], contacts: Contacts, r: float
) -> Curve:
    """Builds the curve under the path of a disk of radius ``r``."""
    # A length as a difference of coordinates: where |∂p/∂u| is least it is largest, which leaves room everywhere.
    room = ROOM * r / contacts.lengths[:, 0].min()
    low, high = float(np.min(z)) - room, float(np.max(z)) + room
    if isinstance(surface, Cylinder):
        # Not more than once around.
        middle, half = (low + high) / 2, np.pi * float(surface.radius)
        low, high = max(low, middle - half), min(high, middle + half)
    along = np.linspace(low, high, POINTS)
    grid = np.stack([np.asarray(u) for u in surface.section(to_array(along))], axis=-1)[:, None]
    points = mesh_points(surface, times if contacts.deforms else times[:1], grid)
    return Curve(points[:, :, 0], along, z, contacts)


def _part(surface: AbstractSurface, every: Sequence[Contacts], r: float) -> Float[np.ndarray, "rows columns 2"]:
    """Returns the finest grid over the part of the surface near the paths: a disc of directions, else a rectangle."""
    coordinates = np.concatenate([contacts.coordinates for contacts in every])
    shares = np.linspace(0.0, 1.0, FINEST + 1)
    R = _radius_of_coordinates(surface)
    if R is not None:
        # Stereographic coordinates are 2 R tan(angle / 2).
        angle = 2 * np.arctan(np.max(np.linalg.norm(coordinates, axis=1)) / (2 * R)) + ROOM * r / R
        # At least a part of the sphere that is seen as one, at most short of the pole, where they are infinite.
        rho = 2 * R * np.tan(min(max(angle, min(BEND, 20 * r / R)), TOP) * shares / 2)
        around = 2 * np.pi * shares
        return rho[:, None, None] * np.stack([np.cos(around), np.sin(around)], axis=-1)
    room = ROOM * r / np.concatenate([contacts.lengths for contacts in every]).min(axis=0)
    low, high = coordinates.min(axis=0) - room, coordinates.max(axis=0) + room
    if isinstance(surface, Cylinder):
        half = np.pi * float(surface.radius)
        middle = (low[1] + high[1]) / 2
        low[1], high[1] = max(low[1], middle - half), min(high[1], middle + half)
    u1, u2 = (start + (end - start) * shares for start, end in zip(low, high, strict=True))
    return np.stack(np.meshgrid(u1, u2, indexing="ij"), axis=-1)


def _radius_of_coordinates(surface: AbstractSurface) -> float | None:
    """Returns the radius R of the sphere from which coordinates that are stereographic are projected, or None."""
    if isinstance(surface, Bowl | SphereOutside):
        return float(surface.radius)
    if isinstance(surface, SignedDistance) and surface.centre is not None:
        return float(surface.guess)
    return None


def _step(points: Float[np.ndarray, "S nodes lines 3"], r: float) -> int:
    """Finds the largest step along lines of nodes that leaves the nodes between within ``CLOSE`` of its chords."""
    # Only steps that divide the number of cells, so that the last line is kept.
    for step in range(FINEST // COARSEST, 1, -1):
        if FINEST % step == 0 and _farthest(points, step) <= CLOSE * r:
            return step
    return 1


def _farthest(points: Float[np.ndarray, "S nodes lines 3"], step: int) -> float:
    """Computes the largest distance of nodes from the points of the chords at the same share of their coordinates."""
    starts, ends = points[:, :-1:step], points[:, step::step]
    shares = (np.arange(step) / step)[:, None, None]
    chords = starts[:, :, None] + shares * (ends - starts)[:, :, None]
    inner = points[:, :-1].reshape(chords.shape)
    return float(np.max(np.linalg.norm(inner - chords, axis=-1)))
