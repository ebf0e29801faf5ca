"""A ground that is a surface, on the page: its motion, the contact points on it, and a mesh of the part near them.

The page has the axes of space. A mesh and the contact points are in axes that the surface's motion carries; the mesh of
a ground that also changes its form differs from one time to the next.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..numerics import programs
from ..numerics.arrays import to_array
from ..numerics.vectors import apply, cross, unit_vector
from ..physics.surfaces import AbstractSurface, Bowl, Cylinder, MovingFrame, SphereOutside

ROOM = 1.6  # from the path to the edge of the mesh, in radii
CLOSE = 0.02  # radii, the allowed distance of the surface from the lines of the mesh
FINEST, COARSEST = 120, 12  # cells of the mesh in each direction
BEND = 1.5  # rad from the lowest or highest point of a sphere, beyond which a mesh of it need not go
TOP = 0.98 * np.pi  # rad, where the coordinates of a sphere are not yet too large


class Contacts(NamedTuple):
    """Where a ball touches a surface at the saved times, and where the surface is."""

    coordinates: Float[np.ndarray, "T 2"]
    points: Float[np.ndarray, "T 3"]  # axes that move with the surface
    normals: Float[np.ndarray, "T 3"]  # space axes
    slopes: Float[np.ndarray, "T 2 3"]  # ∂p/∂u1 and ∂p/∂u2, space axes
    turns: Float[np.ndarray, "T 3 3"]  # from axes that move with the surface to those of space
    moved: Float[np.ndarray, "T 3"]  # of their origin
    deforms: bool

    def carry(self, points: Float[np.ndarray, "points 3"], k: int) -> Float[np.ndarray, "points 3"]:
        """Points that move with the surface, at the k-th time."""
        return points @ self.turns[k].T + self.moved[k]

    def lifted(self, height: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T 3"]:
        """Points at a height above the contact points, axes that move with the surface."""
        return self.points + height[:, None] * np.einsum("kij,ki->kj", self.turns, self.normals)

    def laid(self, points: Float[np.ndarray, "points 3"], k: int) -> Float[np.ndarray, "points 3"]:
        """Points of a plane, laid into that which touches the surface at the k-th time, space axes."""
        first, normal = self.tangents[k], self.normals[k]
        return self.feet[k] + points @ np.stack([first, np.cross(normal, first), normal])

    @property
    def lengths(self) -> Float[np.ndarray, "T 2"]:
        """|∂p/∂u| by each coordinate."""
        return np.linalg.norm(self.slopes, axis=2)

    @property
    def tangents(self) -> Float[np.ndarray, "T 3"]:
        """The unit vectors along ∂p/∂u1."""
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
        """Where the nodes are at the k-th time, space axes."""
        points = self.points[k if len(self.points) > 1 else 0]
        return self.contacts.carry(points.reshape(-1, 3), k).reshape(points.shape)

    def trail(self, k: int) -> Float[np.ndarray, "points 3"]:
        """The pieces of the ground that the ball has touched until the k-th time, where they are then, space axes."""
        if len(self.points) == 1:
            return self.contacts.carry(self.contacts.points[: k + 1], k)
        place, points = nodes(self.grid, self.contacts.coordinates[: k + 1]), self.at(k)
        i, j = (
            np.minimum(np.floor(share).astype(int), size - 2)
            for share, size in zip(place.T, points.shape, strict=False)
        )
        s, t = (place - np.stack([i, j], axis=1)).T[:, :, None]
        near, far = ((1 - t) * points[p, j] + t * points[p, j + 1] for p in (i, i + 1))
        return (1 - s) * near + s * far

    def everywhere(self) -> Float[np.ndarray, "points 3"]:
        """Where the nodes come during the run; of a long one, at some of its times."""
        times = np.unique(np.linspace(0, len(self.contacts.moved) - 1, 40 if self.contacts.moves else 1).astype(int))
        return np.concatenate([self.at(int(k)).reshape(-1, 3) for k in times])


def contacts_of(
    surface: AbstractSurface, times: Float[np.ndarray, " T"], coordinates: Float[np.ndarray, "T 2"]
) -> Contacts:
    """The contact points with these coordinates at the saved times."""
    given = surface, to_array(times), to_array(coordinates)
    *found, rate = map(np.asarray, _touched(*given))
    return Contacts(np.asarray(coordinates), *found, deforms=bool(np.any(rate != 0)))


@programs.filter_jit
def _touched(surface: AbstractSurface, times: Any, coordinates: Any) -> tuple[Any, ...]:
    """The arrays of :class:`Contacts` after the coordinates, and how fast the matter moves in the surface's axes."""
    surface = surface.prepare()
    frame = MovingFrame() if surface.motion is None else surface.motion

    def at_time(t, u):
        def rates(function, x):
            return jax.jvp(function, (x,), (jnp.ones_like(x),))

        point, rate = rates(lambda x: surface.point(x, u[0], u[1]), t)
        _, first = rates(lambda x: surface.point(t, x, u[1]), u[0])
        _, second = rates(lambda x: surface.point(t, u[0], x), u[1])
        corners = jnp.concatenate([jnp.zeros((1, 3), t.dtype), jnp.eye(3, dtype=t.dtype)])
        corners = jax.vmap(lambda x: frame.place(t, x))(corners)
        turn = (corners[1:] - corners[:1]).T
        slopes = jnp.stack([apply(turn, first), apply(turn, second)])
        return point, unit_vector(cross(*slopes)), slopes, turn, corners[0], rate

    return jax.vmap(at_time)(times, coordinates)


def nodes(grid: Float[np.ndarray, "rows columns 2"], coordinates: Float[np.ndarray, "T 2"]) -> Float[np.ndarray, "T 2"]:
    """The row and the column of a rectangular grid at which coordinates are, between whole numbers."""
    low, high = grid[0, 0], grid[-1, -1]
    return np.clip((coordinates - low) / (high - low), 0.0, 1.0) * (np.array(grid.shape[:2]) - 1)


def mesh_under(surface: AbstractSurface, times: Float[np.ndarray, " T"], contacts: Contacts, r: float) -> Mesh:
    """The mesh under the path of a ball of radius ``r``."""
    grid = mesh_grid(surface, [contacts], times, r)
    return Mesh(mesh_points(surface, times if contacts.deforms else times[:1], grid), grid, contacts)


def mesh_grid(
    surface: AbstractSurface, every: Sequence[Contacts], times: Float[np.ndarray, " T"], r: float
) -> Float[np.ndarray, "rows columns 2"]:
    """The coordinates of the nodes of a mesh under all paths; ``times`` are those of the first of them.

    It is as coarse as keeps its lines within ``CLOSE`` of the surface.
    """
    fine = _part(surface, every, r)
    some = np.unique(np.linspace(0, len(times) - 1, 5 if every[0].deforms else 1).astype(int))
    points = mesh_points(surface, times[some], fine)
    rows, columns = (_step(np.moveaxis(points, axis, 1).reshape(len(some), FINEST + 1, -1, 3), r) for axis in (1, 2))
    return fine[::rows, ::columns]


def mesh_points(
    surface: AbstractSurface, times: Float[np.ndarray, " S"], grid: Float[np.ndarray, "rows columns 2"]
) -> Float[np.ndarray, "S rows columns 3"]:
    """The nodes of a mesh at each time, in axes that move with the surface."""
    return np.asarray(_points(surface, to_array(times), to_array(grid)))


@programs.filter_jit
def _points(surface: AbstractSurface, times: Any, grid: Any) -> Any:
    surface = surface.prepare()

    def at_time(t):
        nodes = jax.vmap(lambda u: surface.point(t, u[0], u[1]))(grid.reshape(-1, 2))
        return nodes.reshape((*grid.shape[:2], 3))

    return jax.vmap(at_time)(times)


def _part(surface: AbstractSurface, every: Sequence[Contacts], r: float) -> Float[np.ndarray, "rows columns 2"]:
    """The finest grid over the part of the surface near the paths: a disc of a sphere, else a rectangle."""
    coordinates = np.concatenate([one.coordinates for one in every])
    shares = np.linspace(0.0, 1.0, FINEST + 1)
    if isinstance(surface, Bowl | SphereOutside):
        R = float(surface.radius)
        angle = 2 * np.arctan(np.max(np.linalg.norm(coordinates, axis=1)) / (2 * R)) + ROOM * r / R
        rho = 2 * R * np.tan(min(max(angle, min(BEND, 20 * r / R)), TOP) * shares / 2)
        around = 2 * np.pi * shares
        return rho[:, None, None] * np.stack([np.cos(around), np.sin(around)], axis=-1)
    room = ROOM * r / np.concatenate([one.lengths for one in every]).min(axis=0)
    low, high = coordinates.min(axis=0) - room, coordinates.max(axis=0) + room
    if isinstance(surface, Cylinder):
        half = np.pi * float(surface.radius)
        middle = (low[1] + high[1]) / 2
        low[1], high[1] = max(low[1], middle - half), min(high[1], middle + half)
    u1, u2 = (start + (end - start) * shares for start, end in zip(low, high, strict=True))
    return np.stack(np.meshgrid(u1, u2, indexing="ij"), axis=-1)


def _step(points: Float[np.ndarray, "S nodes lines 3"], r: float) -> int:
    """The largest step along lines of nodes that leaves those between within ``CLOSE`` of its chords."""
    for step in range(FINEST // COARSEST, 1, -1):
        if FINEST % step == 0 and _farthest(points, step) <= CLOSE * r:
            return step
    return 1


def _farthest(points: Float[np.ndarray, "S nodes lines 3"], step: int) -> float:
    """The largest distance of nodes from the point of the chord in the same share of its coordinates."""
    starts, ends = points[:, :-1:step], points[:, step::step]
    shares = (np.arange(step) / step)[:, None, None]
    chords = starts[:, :, None] + shares * (ends - starts)[:, :, None]
    inner = points[:, :-1].reshape(chords.shape)
    return float(np.max(np.linalg.norm(inner - chords, axis=-1)))
