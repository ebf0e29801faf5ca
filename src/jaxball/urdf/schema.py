"""What the elements of a URDF file may have: the attributes that move something, and those that do not.

A misspelt attribute of the first kind of element would be passed over, and the robot be another one.
"""

import xml.etree.ElementTree as ET
from typing import NamedTuple

from ..interface.wording import all_of, did_you_mean
from ..mjcf.elements import label
from .elements import URDFError


class Element(NamedTuple):
    """The attributes of an element, and the elements in it, each of them once unless it is among ``often``.

    - ``strict``: whether others are refused; else a note tells of them.
    """

    attributes: tuple[str, ...] = ()
    inner: tuple[str, ...] = ()
    often: tuple[str, ...] = ()
    strict: bool = True


FRAME = ("xyz", "rpy")
SHAPE = Element(("name",), ("origin", "geometry", "material"), strict=False)
UNREAD = Element(strict=False)  # a note tells of it as a whole, or nothing moves by it
TABLE = {
    "robot": Element(("name", "version"), often=("link", "joint", "material"), strict=False),
    "link": Element(("name",), ("inertial",), ("visual", "collision"), strict=False),
    "inertial": Element((), ("origin", "mass", "inertia")),
    "mass": Element(("value",)),
    "inertia": Element(("ixx", "ixy", "ixz", "iyy", "iyz", "izz")),
    "origin": Element(FRAME),
    "visual": SHAPE,
    "collision": SHAPE,
    "geometry": Element((), ("sphere", "box", "cylinder", "capsule", "mesh")),
    "sphere": Element(("radius",)),
    "box": Element(("size",)),
    "cylinder": Element(("radius", "length")),
    "capsule": Element(("radius", "length")),
    "joint": Element(
        ("name", "type"),
        ("origin", "parent", "child", "axis", "dynamics", "limit", "mimic", "calibration", "safety_controller"),
        strict=False,
    ),
    "parent": Element(("link",)),
    "child": Element(("link",)),
    "axis": Element(("xyz",)),
    "dynamics": Element(("damping", "friction")),
    # The last three are those of newer controllers; no limit is read here.
    "limit": Element(("lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk")),
}


def check_names(robot: ET.Element) -> list[str]:
    """Returns a sentence for each attribute, and each element in a link or a joint, that is not read.

    **Raises:** :class:`URDFError` for an attribute that is misspelt, or that would move something, and for a second
    element where there is to be one.
    """
    notes = []
    waiting = [(robot, robot)]
    while waiting:
        element, owner = waiting.pop()
        kind = TABLE.get(element.tag, UNREAD)
        if kind is UNREAD:
            continue
        where = label(element) if element is owner else f"<{element.tag}> in {label(owner)}"
        others = [name for name in element.attrib if name not in kind.attributes]
        for name in others:
            _check_attribute(name, where, kind)
        if others:
            notes.append(f"{all_of([f'`{name}`' for name in others])} of {where} {_were(others)} not read.")
        notes += _check_inner(element, where, kind)
        waiting += [(child, child if child.get("name") else owner) for child in reversed(element)]
    return notes


def _check_attribute(name: str, where: str, kind: Element) -> None:
    near = did_you_mean(name, kind.attributes, quote="`")
    if kind.strict or near != ".":
        raise URDFError(f"Attribute `{name}` of {where} must be one that URDF has{near}")


def _check_inner(element: ET.Element, where: str, kind: Element) -> list[str]:
    """Returns the sentence about elements in another that are not read."""
    accepted, tags = (*kind.inner, *kind.often), [child.tag for child in element]
    for tag in kind.inner:
        if tags.count(tag) > 1:
            raise URDFError(
                f"There must be one <{tag}> in {where}, but there are {tags.count(tag)}; leave the others out."
            )
    others = list(dict.fromkeys(tag for tag in tags if tag not in accepted))
    for tag in others:
        near = did_you_mean(tag, accepted)
        if near != ".":
            raise URDFError(f"Element <{tag}> in {where} must be one that URDF has{near}")
    # Those of the robot have a note of their own.
    if not others or element.tag in ("robot", "geometry"):
        return []
    return [f"{all_of([f'<{tag}>' for tag in others])} in {where} {_were(others)} not read."]


def _were(names: list[str]) -> str:
    return "was" if len(names) == 1 else "were"
