"""Gives the elements of MuJoCo's files the attributes of their classes, those of ``<default>``."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping

from .elements import ORIENTATIONS, MJCFError, label, refuse_what_holds
from .schema import KINDS_OF_ACTUATORS, SHARED

MAIN = "main"
IN_BODIES = ("geom", "joint", "site")
EVERY_ACTUATOR = "every actuator"  # no tag, under which a class has what it gives to all of them
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
        _collect(element, classes[MAIN], classes)
        root.remove(element)
    for world in root.findall("worldbody"):
        _apply_in(world, classes)
    for actuators in root.findall("actuator"):
        for element in actuators:
            _complete(element, _of_actuator(element, _class_of(element, None, classes)))


def _collect(outermost: ET.Element, inherited: Class, classes: dict[str, Class]) -> None:
    """Adds the classes of an outermost ``<default>`` and those within it, which inherit from it."""
    # By a list, as below, because a file may be nested more deeply than functions may be.
    waiting = [(outermost, outermost.get("class", MAIN), inherited)]
    while waiting:
        element, name, inherited = waiting.pop()
        if name is None:
            raise MJCFError(f"Element {label(element)} within another one must have a `class`, but it has none.")
        # Those of a tag that a class does not change are shared, not copied.
        defaults = dict(inherited)
        for child in element:
            if child.tag != "default":
                defaults[child.tag] = _override(defaults.get(child.tag, {}), child.attrib)
            # What the last of them states holds for actuators of every kind.
            if child.tag in KINDS_OF_ACTUATORS:
                shared = {name: value for name, value in child.attrib.items() if name in SHARED}
                defaults[EVERY_ACTUATOR] = {**defaults.get(EVERY_ACTUATOR, {}), **shared}
        classes[name] = defaults
        # Elements that name no class have the outermost one, whatever its name is.
        if element is outermost:
            classes[MAIN] = defaults
        waiting += [(child, child.get("class"), defaults) for child in reversed(element.findall("default"))]


def _override(inherited: Attributes, attributes: Attributes) -> dict[str, str]:
    """Returns the attributes of a class, and those that it inherits and does not replace."""
    replaced = _orientations_in(attributes)
    return {name: value for name, value in inherited.items() if name not in replaced} | dict(attributes)


def _orientations_in(attributes: Attributes) -> tuple[str, ...]:
    """Returns the attributes of which one that is stated replaces all: orientations, and ends in place of one."""
    every = (*ORIENTATIONS, "fromto")
    return every if any(name in attributes for name in every) else ()


def _apply_in(world: ET.Element, classes: Mapping[str, Class]) -> None:
    waiting = [(world, world.get("childclass"))]
    while waiting:
        body, childclass = waiting.pop()
        for element in body:
            if element.tag == "body":
                waiting.append((element, element.get("childclass", childclass)))
            elif element.tag in IN_BODIES:
                _complete(element, _class_of(element, childclass, classes).get(element.tag, {}))
                if element.tag == "joint" and element.get("type") == "free":
                    _make_free(element)


def _class_of(element: ET.Element, childclass: str | None, classes: Mapping[str, Class]) -> Class:
    name = element.get("class", childclass or MAIN)
    if name not in classes:
        raise MJCFError(f'Attribute `class` of {label(element)} must be a class of <default>, but it is "{name}".')
    return classes[name]


def _of_actuator(element: ET.Element, defaults: Class) -> Attributes:
    """Returns the defaults of an actuator, of which MuJoCo has one set for all kinds."""
    for tag in KINDS_OF_ACTUATORS:
        for name in defaults.get(tag, {}):
            if tag != element.tag and name not in SHARED:
                raise MJCFError(
                    f"Attribute `{name}` of <{tag}> in <default> must be left out, because {label(element)} is an "
                    f"actuator of another kind; give it to each <{tag}>."
                )
    return {**defaults.get(element.tag, {}), **defaults.get(EVERY_ACTUATOR, {})}


def _complete(element: ET.Element, defaults: Attributes) -> None:
    """Sets the attributes that an element lacks; one orientation replaces another, as ends do a place."""
    for name, value in _override(defaults, element.attrib).items():
        element.set(name, value)
    element.attrib.pop("class", None)


def _make_free(joint: ET.Element) -> None:
    refuse_what_holds(joint)
    joint.tag = "freejoint"
