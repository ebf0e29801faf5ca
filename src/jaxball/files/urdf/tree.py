"""The elements of URDF files, and the tree of links that they make.

Of links it is read where they are with every joint at 0, and which are fixed to each other. A table says which
attributes move something and which do not: a misspelt one of the first kind would be passed over, and the robot be
another one.
"""

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...interface.wording import UserError, all_of, did_you_mean
from ...physics.conditions import real_inertia
from ..mjcf.elements import Frame, Inertial, Source, combine, label, principal, read_numbers, read_xml

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


HINGES, SLIDERS = ("revolute", "continuous"), ("prismatic",)
MOVING = (*HINGES, *SLIDERS)
INSTEAD = {
    "planar": "two prismatic joints and a continuous one",
    "floating": "three prismatic and three continuous joints",
    "ball": "three continuous joints",
    "spherical": "three continuous joints",
}


class Joint(NamedTuple):
    """A joint: its element, and the names of its parent and its child."""

    element: ET.Element
    parent: str
    child: str

    @property
    def kind(self) -> str:
        return self.element.get("type", "")


class Tree(NamedTuple):
    """A robot of links.

    - ``links``: their elements by their names.
    - ``frames``: theirs in that of the root, with every joint at 0.
    - ``joints``: those that move.
    - ``rigid``: of each link, the first link of those that are fixed to each other.
    """

    links: dict[str, ET.Element]
    frames: dict[str, Frame]
    joints: list[Joint]
    rigid: dict[str, str]

    def together(self, link: str) -> list[str]:
        """Lists the links that are fixed to a link, itself among them."""
        return [name for name, first in self.rigid.items() if first == self.rigid[link]]

    def inertial(self, link: str) -> Inertial | None:
        """Returns the inertia, in the frame of the root, of the links that are fixed to one; None if they have none."""
        parts = []
        for name in self.together(link):
            inertia = inertial_of(self.links[name])
            if inertia is not None:
                parts.append(inertia._replace(axes=self.frames[name].then(inertia.axes)))
        return (parts[0] if len(parts) == 1 else combine(parts)) if parts else None


def read_tree(robot: ET.Element) -> Tree:
    """Reads the links and the joints of a file.

    **Raises:** :class:`URDFError` for links that are no tree, and for joints of other kinds.
    """
    links = _elements_by_name(robot, "link")
    joints = [_joint(element, links) for element in _elements_by_name(robot, "joint").values()]
    above: dict[str, Joint] = {}
    for joint in joints:
        if joint.child in above:
            raise URDFError(
                f"Element {label(links[joint.child])} must be the child of one joint, but it is that of "
                f"{label(above[joint.child].element)} and {label(joint.element)}; leave one of them out."
            )
        above[joint.child] = joint
    root = _root(links, above)
    floating = [joint for joint in joints if joint.kind == "floating" and _is_world(joint, root, links, joints)]
    frames, rigid = {root: Frame(np.eye(3), np.zeros(3))}, {root: root}
    waiting = [root]
    while waiting:
        # Parents before children, whose frames and rigid parts follow from theirs.
        parent = waiting.pop()
        for joint in (joint for joint in joints if joint.parent == parent):
            if joint not in floating:
                _check_kind(joint)
            frames[joint.child] = frames[parent].then(origin_of(joint.element, joint.element))
            rigid[joint.child] = rigid[parent] if joint.kind == "fixed" else joint.child
            waiting.append(joint.child)
    # A loop has no end from which the root could reach it.
    lost = [label(links[name]) for name in links if name not in frames]
    if lost:
        raise URDFError(f"The joints must be a tree, but {all_of(lost)} are in a loop; leave one of its joints out.")
    return Tree(links, frames, [joint for joint in joints if joint.kind in MOVING], rigid)


def _elements_by_name(robot: ET.Element, tag: str) -> dict[str, ET.Element]:
    elements: dict[str, ET.Element] = {}
    for element in robot.findall(tag):
        name = element.get("name")
        if not name:
            raise URDFError(f"Every <{tag}> must have a `name`, but one of them has none.")
        if name in elements:
            raise URDFError(f"Element {label(element)} must have a name of its own, but there are two with this one.")
        elements[name] = element
    return elements


def _joint(element: ET.Element, links: dict[str, ET.Element]) -> Joint:
    ends = []
    for tag in ("parent", "child"):
        part = element.find(tag)
        name = None if part is None else part.get("link")
        if name is None or name not in links:
            clause = "it has none" if name is None else f'it is "{name}"'
            raise URDFError(f"The <{tag}> of {label(element)} must be a link of the file, but {clause}.")
        ends.append(name)
    return Joint(element, *ends)


def _root(links: dict[str, ET.Element], above: dict[str, Joint]) -> str:
    roots = [name for name in links if name not in above]
    if len(roots) == 1:
        return roots[0]
    if not links:
        raise URDFError("The file must have a <link>, the shell, but it has none.")
    which = f"there are {all_of([label(links[name]) for name in roots])}" if roots else "every link is one"
    raise URDFError(
        f"There must be one link that is no child of a joint, the root, but {which}; join all links to one by joints."
    )


def _is_world(joint: Joint, root: str, links: dict[str, ET.Element], joints: list[Joint]) -> bool:
    """Returns whether a joint lets the whole robot move in a world, a link that has nothing of its own."""
    alone = [other for other in joints if other.parent == root] == [joint]
    return joint.parent == root and alone and not list(links[root])


def _check_kind(joint: Joint) -> None:
    if joint.element.find("mimic") is not None:
        raise URDFError(
            f"Element <mimic> of {label(joint.element)} must be left out, because a joint that follows another has no "
            "counterpart here; drive it in the scenario."
        )
    if joint.parent == "world" and joint.kind == "fixed":
        raise URDFError(
            f"Element {label(joint.element)} must be of the type floating, because the robot rolls, but it is fixed "
            'to the link "world"; leave both out.'
        )
    if joint.kind not in (*MOVING, "fixed"):
        instead = f"; write {INSTEAD[joint.kind]} instead" if joint.kind in INSTEAD else ""
        raise URDFError(
            f"Element {label(joint.element)} must be of the type revolute, continuous, prismatic or fixed inside a "
            f'shell, but its type is "{joint.kind}"{instead}.'
        )
