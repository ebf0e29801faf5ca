"""Positions, orientations and inertias of MuJoCo's elements."""

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from .elements import MJCFError, called, number, numbers

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")


class Frame(NamedTuple):
    """A frame in another one: a point x of it is at ``turn`` x + ``shift``."""

    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]

    def of_point(self, x: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        return self.turn @ x + self.shift

    def then(self, inner: "Frame") -> "Frame":
        """The frame that is ``inner`` in this one."""
        return Frame(self.turn @ inner.turn, self.of_point(inner.shift))


class Angles(NamedTuple):
    """The unit of angles in rad, and the sequence of Euler's angles as SciPy has it: rotating axes in capitals."""

    unit: float
    sequence: str


class Inertial(NamedTuple):
    """A mass, the frame of its principal axes at its centre, and its principal moments."""

    mass: float
    axes: Frame
    moments: Float[np.ndarray, "3"]


def frame_of(element: ET.Element, angles: Angles) -> Frame:
    """The frame of an element in that of its parent; raises a :class:`MJCFError` for numbers that are not one."""
    return Frame(_turn(element, angles), numbers(element, "pos", np.zeros(3)))


def _turn(element: ET.Element, angles: Angles) -> Float[np.ndarray, "3 3"]:
    given = [name for name in ORIENTATIONS if element.get(name) is not None]
    if not given:
        return np.eye(3)
    if len(given) > 1:
        raise MJCFError(
            f"Element {called(element)} must have one orientation, but it has `{given[0]}` and `{given[1]}`."
        )
    name, count = given[0], {"quat": 4, "axisangle": 4, "xyaxes": 6}.get(given[0], 3)
    values = numbers(element, name, count=count)
    if name == "quat" and np.any(values != 0):
        return Rotation.from_quat(np.roll(values, -1)).as_matrix() if np.any(values[1:] != 0) else np.eye(3)
    if name == "axisangle" and np.any(values[:3] != 0):
        axis = values[:3] / np.linalg.norm(values[:3])
        return Rotation.from_rotvec(axis * values[3] * angles.unit).as_matrix()
    if name == "euler":
        return Rotation.from_euler(angles.sequence, values * angles.unit).as_matrix()
    if name == "xyaxes":
        x = values[:3] / np.linalg.norm(values[:3])
        y = values[3:] - (values[3:] @ x) * x
        return np.column_stack([x, y / np.linalg.norm(y), np.cross(x, y / np.linalg.norm(y))])
    raise MJCFError(
        f"Attribute `{name}` of {called(element)} must be a `quat`, `axisangle`, `xyaxes` or `euler` that is not 0, "
        f'but it is "{element.get(name)}".'
    )


def stated_inertial(body: ET.Element, angles: Angles) -> Inertial | None:
    """The inertia that a body states, in its own frame; None if it states none."""
    element = body.find("inertial")
    if element is None:
        return None
    frame, mass = frame_of(element, angles), number(element, "mass")
    if element.get("fullinertia") is None:
        return Inertial(mass, frame, numbers(element, "diaginertia", np.zeros(3)))
    xx, yy, zz, xy, xz, yz = numbers(element, "fullinertia", count=6)
    moments, axes = principal(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return Inertial(mass, Frame(frame.turn @ axes, frame.shift), moments)


def principal(inertia: Float[np.ndarray, "3 3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """The principal moments of an inertia, and its principal axes as the columns of a rotation."""
    if np.array_equal(inertia, np.diag(np.diag(inertia))):
        return np.diag(inertia), np.eye(3)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return moments, axes
