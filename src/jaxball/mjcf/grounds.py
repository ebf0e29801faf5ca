"""Writes the ground of a scenario as MJCF: a plane, a turntable, a sphere, or a height field of flat triangles."""

import xml.etree.ElementTree as ET
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import describe
from ..numerics.arrays import to_array
from ..physics.body import System
from ..physics.grounds import AbstractSurface, SphereOutside
from ..physics.grounds.ground import Ground
from ..physics.prescribed.schedules import ConstantRate
from .elements import MJCFError, add

TABLE_RADIUS = 100.0  # the radius of a turntable, in radii of the body
FLYWHEEL = 1e6  # the moment of inertia of a turntable in M r²; solvers lose small ones beside 1e8 to rounding
EXTENT = 10.0  # half the side of a height field, in radii of the body
SPACING = 0.2  # the most between its points, in the same
LARGEST_EXTENT = 100.0  # the same: a file has every height as text
TIMES_AT_REST = 16  # of a scenario, at which a ground must be where it is at the start


def check_ground(system: System, times: Float[np.ndarray, " T"]) -> None:
    """Raises a :class:`MJCFError` for a ground that MJCF cannot express."""
    ground = system.ground
    if isinstance(ground, AbstractSurface):
        _check_surface(ground, times)
    if ground is not None and ground.belt is not None:
        raise MJCFError("Key `ground.belt` must be left out to be written as MJCF, which has no belts.")
    if not isinstance(ground, Ground):
        return
    if ground.motion is not None:
        raise MJCFError("Key `ground.motion` must be left out to be written as MJCF, where the plane stays at rest.")
    if ground.turntable is not None and not isinstance(ground.turntable.turning, ConstantRate):
        raise MJCFError(
            "Key `ground.turntable.turning` must be a constant rate to be written as MJCF, where a heavy disk turns "
            f"freely, but it is a {type(ground.turntable.turning).__name__}."
        )


def _check_surface(ground: AbstractSurface, times: Float[np.ndarray, " T"]) -> None:
    must = "Key `ground` must be at rest to be written as MJCF, but"
    if ground.motion is not None or ground.turntable is not None:
        what = "motion" if ground.turntable is None else "turntable"
        raise MJCFError(f"{must} {describe(ground)} with a {what} is not.")
    some = times[:: -(-len(times) // TIMES_AT_REST)]
    # A height is over (x, y) itself; on another surface a pair of coordinates is elsewhere.
    x = y = to_array([0.37, -0.21])  # any two places, in whatever unit: a height is over all of them
    first = _places(ground, to_array(float(times[0])), x, y)
    if not isinstance(ground, SphereOutside) and not np.array_equal(first[:, :2], np.stack([x, y], axis=1)):
        raise MJCFError(
            "Key `ground` must be a plane, the outside of a sphere, or a height over x and y, such as a HeightField, "
            f"to be written as MJCF, but it is {describe(ground)}."
        )
    moved = [_places(ground, to_array(float(t)), x, y) for t in some]
    # NaN is where there is no ground, which is not a motion.
    if not all(np.array_equal(first, later, equal_nan=True) for later in moved):
        raise MJCFError(f"{must} it moves.")


@eqx.filter_jit
def _places(ground: AbstractSurface, t: Array, x: Float[Array, " n"], y: Float[Array, " n"]) -> Float[Array, "n 3"]:
    prepared = ground.prepare()
    return jax.vmap(lambda x, y: prepared.place(t, x, y))(x, y)


def centre_at_start(
    system: System, t: Float[Array, ""], z: Float[Array, "*two"], height: Float[Array, ""]
) -> Float[np.ndarray, "3"]:
    """Returns where the centre of a body is in space that is ``height`` above the place ``z`` of its ground, length."""
    ground, r = system.ground, system.radius + height
    if isinstance(ground, AbstractSurface):
        return np.asarray(ground.prepare().place_of_centre(t, r, z))
    x, y = np.append(np.asarray(z), 0.0)[:2]  # a disk rolls along e1
    return np.array([x, y, float(r)])


def write_ground(
    root: ET.Element,
    world: ET.Element,
    system: System,
    start: tuple[Float[Array, ""], Float[np.ndarray, "3"]],
    friction: dict[str, Any],
    extent: float | None,
) -> tuple[str, ...]:
    """Writes the ground into the ``world``, and its heights into ``root``; returns a sentence if MuJoCo has another.

    ``start`` is the time and the place of the body's centre then, around which a height field is written up to
    ``extent``.
    """
    r, ground = float(system.radius), system.ground
    if isinstance(ground, SphereOutside):
        R = float(ground.radius)
        add(world, "geom", name="ground", type="sphere", size=R, pos=(0.0, 0.0, -R), **friction)
        return ()
    if isinstance(ground, AbstractSurface):
        return _write_heights(root, world, ground, start, r, friction, EXTENT * r if extent is None else extent)
    if not isinstance(ground, Ground) or ground.turntable is None:
        # Zeros are a plane without end; the last number is the mesh in which it is drawn.
        add(world, "geom", name="plane", type="plane", size=(0.0, 0.0, 0.1 * r), **friction)
        return ()
    centre = np.asarray(ground.turntable.centre)
    # As half the disk's height is r, its top is the plane z = 0.
    table = add(world, "body", name="turntable", pos=(*centre, -r))
    add(table, "joint", name="turntable", type="hinge", axis=(0.0, 0.0, 1.0))
    # So heavy that nothing on it changes its rate.
    heavy = FLYWHEEL * float(system.total_mass) * r**2
    add(table, "inertial", pos=np.zeros(3), mass=system.total_mass, diaginertia=(heavy,) * 3)
    add(table, "geom", name="turntable", type="cylinder", size=(TABLE_RADIUS * r, r), **friction)
    return ()


def _write_heights(
    root: ET.Element,
    world: ET.Element,
    ground: AbstractSurface,
    start: tuple[Float[Array, ""], Float[np.ndarray, "3"]],
    r: float,
    friction: dict[str, Any],
    extent: float,
) -> tuple[str, ...]:
    t, centre = start
    largest = LARGEST_EXTENT * r
    if not 0 < extent <= largest:
        raise MJCFError(
            f"Argument `extent` must be a positive length of at most {largest:g}, a hundred radii, because a file has "
            f"a million heights then, but it is {extent:g}."
        )
    # Odd, so that one of them is at the start.
    count = 2 * int(np.ceil(extent / (SPACING * r))) + 1
    offsets = np.linspace(-extent, extent, count)
    # MuJoCo reads heights as one looks at a map: the first row is that of the largest y.
    y, x = (axis.ravel() for axis in np.meshgrid(centre[1] - offsets, centre[0] + offsets, indexing="ij"))
    heights = np.asarray(_places(ground, t, jnp.asarray(x), jnp.asarray(y)))[:, 2]
    if not np.isfinite(heights).all():
        raise MJCFError(
            f"Argument `extent` must be less than {extent:g}, because the ground ends nearer to the start than that."
        )
    lowest, rise = float(heights.min()), float(np.ptp(heights))
    # MuJoCo scales heights to those of `size`, which must be positive, and continues the ground below by the last.
    size = (extent, extent, rise if rise > 0 else r, r)
    name = {"name": "ground"}
    assets = ET.SubElement(root, "asset")
    add(assets, "hfield", **name, nrow=str(count), ncol=str(count), size=size, elevation=heights)
    add(world, "geom", **name, type="hfield", hfield="ground", pos=(centre[0], centre[1], lowest), **friction)
    return (
        f"The ground is a height field of flat triangles with sides of {offsets[1] - offsets[0]:g}, over whose edges a "
        f"ball bumps, and ends {extent:g} from the start.",
    )
