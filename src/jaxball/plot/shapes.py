"""What is in a body, as points and curves in body axes: shell, rails, and mechanisms with their arms."""

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
from ..physics.prescribed.motion import AbstractMotion, rail_of
from ..physics.prescribed.rails import Tube
from ..physics.shape import AbstractShape
from .palette import mass_colour

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
