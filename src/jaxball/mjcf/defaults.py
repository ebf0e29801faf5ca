"""Defaults of MJCF: the attributes of their classes, given to the elements that are read."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from .elements import MJCFError, called, refuse_values
from .frames import ORIENTATIONS

MAIN = "main"
IN_BODIES = ("geom", "joint", "site")
SHARED = ("ctrlrange", "ctrllimited", "forcerange", "forcelimited", "gear", "class")  # by all kinds of actuators
Attributes = Mapping[str, str]
Class = dict[str, dict[str, str]]  # the attributes by the tag


def apply_defaults(root: ET.Element) -> None:
    """Gives the elements of a file the attributes of their classes, and removes the classes.

    A ``<joint type="free">`` becomes the ``<freejoint>`` that it is.

    **Raises:** :class:`MJCFError` for a class that is not there, and for an actuator whose class has the numbers of
    actuators of another kind.
    """
    classes: dict[str, Class] = {MAIN: {}}
    for element in root.findall("default"):
        _collect(element, MAIN, classes[MAIN], classes)
        root.remove(element)
    for world in root.findall("worldbody"):
        _apply_in(world, None, classes)
    for actuators in root.findall("actuator"):
        for element in actuators:
            _complete(element, _of_actuator(element, _class_of(element, None, classes)))


def _collect(element: ET.Element, otherwise: str | None, inherited: Class, classes: dict[str, Class]) -> None:
    """Adds the classes of a ``<default>`` and those within it, which inherit from it."""
    name = element.get("class", otherwise)
    if name is None:
        raise MJCFError(f"Element {called(element)} within another one must have a `class`, but it has none.")
    own = {tag: dict(attributes) for tag, attributes in inherited.items()}
    for child in element:
        if child.tag != "default":
            own[child.tag] = own.get(child.tag, {}) | child.attrib
    classes[name] = own
    if otherwise is not None:
        classes[MAIN] = own
    for child in element.findall("default"):
        _collect(child, None, own, classes)


def _apply_in(body: ET.Element, childclass: str | None, classes: Mapping[str, Class]) -> None:
    childclass = body.get("childclass", childclass)
    for element in body:
        if element.tag == "body":
            _apply_in(element, childclass, classes)
        elif element.tag in IN_BODIES:
            _complete(element, _class_of(element, childclass, classes).get(element.tag, {}))
            if element.tag == "joint" and element.get("type") == "free":
                _make_free(element)


def _class_of(element: ET.Element, childclass: str | None, classes: Mapping[str, Class]) -> Class:
    name = element.get("class", childclass or MAIN)
    if name not in classes:
        raise MJCFError(f'Attribute `class` of {called(element)} must be a class of <default>, but it is "{name}".')
    return classes[name]


def _of_actuator(element: ET.Element, found: Class) -> Attributes:
    """The defaults of an actuator, of which MuJoCo has one set for all kinds."""
    given: dict[str, str] = {}
    for tag in ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion"):
        for name, value in found.get(tag, {}).items():
            if tag != element.tag and name not in SHARED:
                raise MJCFError(
                    f"Attribute `{name}` of <{tag}> in <default> must be left out, because {called(element)} is an "
                    f"actuator of another kind; give it to each <{tag}>."
                )
            given[name] = value
    return given


def _complete(element: ET.Element, defaults: Attributes) -> None:
    """Sets the attributes that an element lacks; one orientation replaces another, as ends do a place."""
    given = set(element.attrib)
    turned = any(name in given for name in (*ORIENTATIONS, "fromto"))
    for name, value in defaults.items():
        if name not in given and not (turned and name in (*ORIENTATIONS, "fromto")):
            element.set(name, value)
    element.attrib.pop("class", None)


def _make_free(joint: ET.Element) -> None:
    refuse_values(
        joint, ("damping", "armature", "frictionloss", "stiffness"), "nothing holds the shell but the plane here"
    )
    joint.tag = "freejoint"
