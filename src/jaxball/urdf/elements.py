"""Elements of URDF files: their text, numbers, frames, inertias and shapes."""

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..interface.wording import UserError
from ..mjcf.elements import Frame, Inertial, label, principal, read_numbers
from ..mjcf.source import Source, read_xml
from ..physics.conditions import real_inertia

MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
SHAPES = ("sphere", "box", "cylinder", "capsule", "mesh")
CONTACT, LOOK = "collision", "visual"


class URDFError(UserError):
    """A robot cannot be read from URDF; the message is one sentence that names the part."""


class Shape(NamedTuple):
    """A shape of a link: its element, whose tag is its kind, its frame in that of the link, and which it is for."""

    element: ET.Element
    frame: Frame
    purpose: str


def parse(source: Source) -> ET.Element:
    """Parses the root of a file, from its path or its text.

    **Raises:** :class:`URDFError` for a file that is not there, a text that is no XML, that declares entities, or that
    xacro has not expanded yet, and for one that has another root.
    """
    root = read_xml(source, "a URDF file", "robot", URDFError)
    for element in root.iter():
        if "xacro" in element.tag or any("${" in value for value in element.attrib.values()):
            raise URDFError(
                f"The file must be expanded by xacro, but it has <{element.tag.rpartition('}')[2]}> with a macro or an "
                "expression; run `xacro robot.urdf.xacro > robot.urdf`."
            )
    return root


def numbers(
    element: ET.Element, name: str, count: int, owner: ET.Element, default: tuple[float, ...] | None = None
) -> Float[np.ndarray, " n"]:
    """Reads the ``count`` numbers of an attribute of an element that belongs to ``owner``.

    **Raises:** :class:`URDFError` where they are missing without a default, or something else.
    """
    where = label(element) if element is owner else f"<{element.tag}> in {label(owner)}"
    return read_numbers(element, name, where, default, count, URDFError)


def number(element: ET.Element, name: str, owner: ET.Element, default: float | None = None) -> float:
    """Reads the number of an attribute; raises as :func:`numbers`."""
    return float(numbers(element, name, 1, owner, None if default is None else (default,))[0])


def origin_of(element: ET.Element, owner: ET.Element) -> Frame:
    """Reads the frame of an element by its <origin>: turned about fixed axes by roll, pitch and yaw, in this order."""
    origin = element.find("origin")
    if origin is None:
        return Frame(np.eye(3), np.zeros(3))
    rpy = numbers(origin, "rpy", 3, owner, (0.0, 0.0, 0.0))
    turn = Rotation.from_euler("xyz", rpy).as_matrix() if np.any(rpy != 0) else np.eye(3)
    return Frame(turn, numbers(origin, "xyz", 3, owner, (0.0, 0.0, 0.0)))


def inertial_of(link: ET.Element) -> Inertial | None:
    """Reads the inertia of a link in its own frame; None where it has none, or one of zeros.

    **Raises:** :class:`URDFError` for an inertia that no body has.
    """
    element = link.find("inertial")
    if element is None:
        return None
    stated = [element.find("mass"), element.find("inertia")]
    for tag, part in zip(("mass", "inertia"), stated, strict=True):
        if part is None:
            raise URDFError(f"Element <inertial> in {label(link)} must have a <{tag}>, but it is missing.")
    mass = number(stated[0], "value", link)  # pyright: ignore[reportArgumentType]
    xx, yy, zz, xy, xz, yz = (number(stated[1], name, link, 0.0) for name in MOMENTS)  # pyright: ignore
    moments, axes = principal(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    # Links for frames and sensors often state zeros instead of nothing.
    if mass == 0 and not np.any(moments):
        return None
    if mass <= 0:
        raise URDFError(f"The mass of {label(link)} must be positive, or 0 without moments, but it is {mass:g}.")
    if not real_inertia(moments).holds or np.min(moments) < 0:
        raise URDFError(
            f"The inertia of {label(link)} must have principal moments of which none exceeds the sum of the other "
            f"two, as in every real body, but they are {', '.join(f'{moment:g}' for moment in moments)}; correct it."
        )
    frame = origin_of(element, link)
    return Inertial(mass, Frame(frame.turn @ axes, frame.shift), moments)


def shapes_of(link: ET.Element) -> list[Shape]:
    """Lists the shapes of a link, the shapes of contacts first.

    **Raises:** :class:`URDFError` for a kind of shape that URDF does not have.
    """
    shapes = []
    for purpose in (CONTACT, LOOK):
        for element in link.findall(purpose):
            inner = list(element.findall("geometry/*"))
            if len(inner) != 1 or inner[0].tag not in SHAPES:
                kinds = ", ".join(f"<{kind}>" for kind in SHAPES)
                labels = ", ".join(label(child) for child in inner) or "nothing"
                raise URDFError(
                    f"The <geometry> of <{purpose}> in {label(link)} must be one of {kinds}, but it is {labels}."
                )
            shapes.append(Shape(inner[0], origin_of(element, link), purpose))
    return shapes


def reach(shape: Shape, link: ET.Element, centre: Float[np.ndarray, "3"]) -> float:
    """Computes how far a shape that is no mesh reaches from a point in the frame of its link."""
    c = shape.frame.turn.T @ (centre - shape.frame.shift)
    if shape.element.tag == "box":
        half = numbers(shape.element, "size", 3, link) / 2
        # To the farthest corner.
        return float(np.linalg.norm(np.abs(c) + half))
    radius = number(shape.element, "radius", link)
    if shape.element.tag == "sphere":
        return float(np.linalg.norm(c)) + radius
    # By symmetry only the distances along the axis and from it count.
    along, across = abs(c[2]) + number(shape.element, "length", link) / 2, float(np.hypot(c[0], c[1]))
    if shape.element.tag == "capsule":
        return float(np.hypot(along, across)) + radius
    return float(np.hypot(along, across + radius))
