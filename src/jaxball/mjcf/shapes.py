"""Computes masses and inertias of geoms, as MuJoCo does where a body states none."""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .elements import (
    Angles,
    Frame,
    Inertial,
    MJCFError,
    combine,
    frame_between,
    frame_of,
    label,
    number,
    numbers,
    read_inertial,
)

DENSITY = 1000.0
Size = Float[np.ndarray, " n"]
Moments = Float[np.ndarray, "3"]


class Solid(NamedTuple):
    """A body of uniform density: how many ``numbers`` its size has, its volume, and its moments over its mass."""

    numbers: int
    volume: Callable[[Size], float]
    moments: Callable[[Size], Moments]


def _ellipsoid(s: Size) -> Moments:
    return np.array([s[1] ** 2 + s[2] ** 2, s[0] ** 2 + s[2] ** 2, s[0] ** 2 + s[1] ** 2]) / 5


def _capsule(s: Size) -> Moments:
    """Computes the moments of a cylinder and two halves of a ball, whose centres of mass are 3/8 of the radius from its
    ends.
    """
    r, h = s
    ends = 2 * r / (3 * h + 2 * r)  # of the mass
    across = (1 - ends) * (r**2 / 4 + h**2 / 3) + ends * (0.4 * r**2 + h**2 + 0.75 * h * r)
    return np.array([across, across, (1 - ends) * r**2 / 2 + ends * 0.4 * r**2])


SOLIDS = {
    "sphere": Solid(1, lambda s: 4 / 3 * np.pi * s[0] ** 3, lambda s: np.full(3, 0.4 * s[0] ** 2)),
    "capsule": Solid(2, lambda s: np.pi * s[0] ** 2 * (2 * s[1] + 4 / 3 * s[0]), _capsule),
    "cylinder": Solid(
        2,
        lambda s: 2 * np.pi * s[0] ** 2 * s[1],
        lambda s: np.array([*[s[0] ** 2 / 4 + s[1] ** 2 / 3] * 2, s[0] ** 2 / 2]),
    ),
    "box": Solid(3, lambda s: 8 * float(np.prod(s)), lambda s: 5 / 3 * _ellipsoid(s)),  # over 3 instead of 5
    "ellipsoid": Solid(3, lambda s: 4 / 3 * np.pi * float(np.prod(s)), _ellipsoid),
}
HOLLOW = Solid(1, lambda s: 4 * np.pi * s[0] ** 2, lambda s: np.full(3, 2 / 3 * s[0] ** 2))


class Inertias(NamedTuple):
    """How a file gives the inertias of its bodies: ``from_geoms`` is true, false, or auto, where a body states none."""

    angles: Angles
    from_geoms: str

    def of(self, body: ET.Element) -> Inertial | None:
        """Returns the inertia of a body in its own frame, None if it has none.

        **Raises:** :class:`MJCFError` for a geom whose mass is not computed here.
        """
        stated = None if self.from_geoms == "true" else read_inertial(body, self.angles)
        return stated if stated or self.from_geoms == "false" else inertial_of_geoms(body, self.angles)


def inertial_of_geoms(body: ET.Element, angles: Angles) -> Inertial | None:
    """Computes the inertia of the geoms of a body in its frame; None where they have no mass.

    **Raises:** :class:`MJCFError` for a geom with a mass whose shape is none of these.
    """
    parts = [part for part in (_part(geom, angles) for geom in body.findall("geom")) if part is not None]
    if not parts:
        return None
    return combine(parts)


def _part(geom: ET.Element, angles: Angles) -> Inertial | None:
    # Before its shape: what has no mass may be a mesh.
    if geom.get("mass") is not None and number(geom, "mass") == 0:
        return None
    density, kind = number(geom, "density", DENSITY), geom.get("type", "sphere")
    if geom.get("mass") is None and density == 0:
        return None
    solid = SOLIDS.get(kind)
    if solid is None or geom.get("mesh") is not None:
        raise MJCFError(
            f"Element {label(geom)} must be one of {', '.join(SOLIDS)}, or have mass 0, or its body an <inertial>, "
            f'because the mass of other shapes is not computed here, but its type is "{kind}".'
        )
    if geom.get("shellinertia") == "true":
        if kind != "sphere":
            raise MJCFError(
                f"Attribute `shellinertia` of {label(geom)} must be left out, because only a sphere can be hollow "
                f"here, but it is a {kind}."
            )
        # MuJoCo's density is per area then, so the area stands for the volume.
        solid = HOLLOW
    frame, size = _place(geom, kind, solid.numbers, angles)
    mass = number(geom, "mass", density * float(solid.volume(size)))
    return Inertial(mass, frame, mass * solid.moments(size))


def _place(geom: ET.Element, kind: str, count: int, angles: Angles) -> tuple[Frame, Size]:
    """Computes the frame and the size of a geom, which a capsule and a cylinder may have between two points."""
    if geom.get("fromto") is None:
        return frame_of(geom, angles), numbers(geom, "size")[:count]
    if kind not in ("capsule", "cylinder"):
        raise MJCFError(
            f"Attribute `fromto` of {label(geom)} must be left out, because only a capsule and a cylinder are read "
            f"between two points, but it is a {kind}."
        )
    # A capsule and a cylinder are bodies of revolution: which end is which does not matter.
    frame, half = frame_between(geom)
    return frame, np.array([numbers(geom, "size")[0], half])
