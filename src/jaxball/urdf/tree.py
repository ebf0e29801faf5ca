"""Reads the tree of links of a URDF file: where they are with every joint at 0, and which are fixed to each other."""

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np

from ..interface.wording import all_of
from ..mjcf.elements import Frame, Inertial, combine, label
from .elements import URDFError, inertial_of, origin_of

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
