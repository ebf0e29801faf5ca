"""What each element of a file may have: attributes that are read, that move nothing, that are told, or are refused.

One table has all of them, as MuJoCo 3.17 has them, so that no attribute is passed over: one that is not in it is
refused by name. What moves nothing is left out: names, looks, memory, and settings of MuJoCo's numerical methods.
Elements are given the attributes of their classes, those of ``<default>``, by the same table.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ...interface.wording import all_of, any_of, did_you_mean
from .elements import ORIENTATIONS, MJCFError, label, numbers, refuse_what_holds

PLACE = "pos quat axisangle xyaxes zaxis euler"
RIGID = "contacts are rigid here"
STICKING = "dry friction holds without creeping here"
NO_ACTIVATION = "actuators have no state of their own here"
NO_COUNTERPART = "it has no counterpart here"
NO_DELAY = "nothing is delayed here"


class Refused(NamedTuple):
    """An attribute that acts in MuJoCo and cannot here: the words that say that it does not act, and why.

    Without words it must be left out, or all of its numbers be 0.
    """

    why: str
    unless: tuple[str, ...] = ()


class Element(NamedTuple):
    """The attributes of an element, by how they are treated, and the elements in it.

    - ``read``, ``idle``: names, with spaces between them; ``idle`` ones move nothing.
    - ``told``: those that act in MuJoCo and not here, with the reason, for a note.
    - ``refused``: those that must not act.
    - ``inner``: the tags that may be in it; None where the readers of this element say so themselves.
    """

    read: str = ""
    idle: str = ""
    told: Mapping[str, str] = {}
    refused: Mapping[str, Refused] = {}
    inner: str | None = ""

    @property
    def names(self) -> tuple[str, ...]:
        return (*self.read.split(), *self.idle.split(), *self.told, *self.refused)


UNREAD = Element(inner=None)  # nothing in it moves anything: its attributes and elements are not looked at
INNER = Element(inner=None)  # what may be in it is checked where it is read
NO_MEDIUM = Refused("a medium has no counterpart here; add `resistance` to the scenario")
STATED = Refused("inertias must be those that the file states")
ON_JOINT = "a `joint` is the only thing that actuators act on here"
ENDS = ("tendon", "site", "refsite", "cranksite", "slidersite")  # of actuators that act on no joint
ACTUATOR = Element(
    "name class joint jointinparent group gear ctrlrange ctrllimited forcerange forcelimited damping",
    "user nsample interp lengthrange cranklength",
    refused={
        "armature": Refused("a rotor geared to a joint has no counterpart here"),
        "delay": Refused(NO_DELAY),
        **dict.fromkeys(ENDS, Refused(ON_JOINT, ("left out",))),
    },
)
SENSOR = Element(
    "name",
    "user noise nsample interp",  # MuJoCo adds no noise either
    refused={
        "cutoff": Refused("readings are not cut off here"),
        "delay": Refused(NO_DELAY),
        "interval": Refused("readings are taken at all times here"),
    },
)


SHARED = frozenset(ACTUATOR.names)  # what a class gives to actuators of every kind


def _with(element: Element, read: str = "", idle: str = "", refused: Mapping[str, Refused] | None = None) -> Element:
    """Returns an element with more attributes."""
    return element._replace(
        read=f"{element.read} {read}", idle=f"{element.idle} {idle}", refused={**element.refused, **(refused or {})}
    )


ACTUATORS = {
    "motor": ACTUATOR,
    "position": _with(
        ACTUATOR,
        "kp kv dampratio",
        refused={"timeconst": Refused(NO_ACTIVATION), "inheritrange": Refused("joints have no ranges here")},
    ),
    "velocity": _with(ACTUATOR, "kv"),
    # Its words are checked where it is read, all at once.
    "general": _with(
        ACTUATOR,
        "dyntype gaintype biastype gainprm biasprm",
        "dynprm input velrange ffrange actdim actlimited actrange actearly",
        refused={
            "inheritrange": Refused("joints have no ranges here"),
            "body": Refused(ON_JOINT, ("left out",)),
        },
    ),
}
OTHER_ACTUATORS = (
    "intvelocity", "damper", "cylinder", "muscle", "adhesion", "pid", "dcmotor", "orientation", "plugin",
)  # fmt: skip
KINDS_OF_ACTUATORS = (*ACTUATORS, *OTHER_ACTUATORS)
GEOM = Element(
    f"name class type contype conaffinity condim priority friction size mass density shellinertia mesh fromto {PLACE}",
    "group material rgba user hfield fitscale fluidshape fluidcoef",
    told=dict.fromkeys(("solref", "solimp", "solmix", "margin", "gap"), RIGID),
    refused={
        "surfacevel": Refused("surfaces move with their bodies here; a turntable or a moving ground is for scenarios"),
        "adhesion": Refused("nothing sticks to the ground here"),
    },
)
JOINT = Element(
    "name class type pos axis stiffness damping springref springdamper frictionloss range limited"
    " actuatorfrcrange actuatorfrclimited",
    # The last three are those of ranges, which are refused.
    "group user actuatorgravcomp margin solreflimit solimplimit",
    told=dict.fromkeys(("solreffriction", "solimpfriction"), STICKING),
    refused={
        "armature": Refused("a rotor geared to a joint has no counterpart here"),
        "ref": Refused("angles are measured from the configuration in which the file has its bodies"),
    },
)
SITE = Element(f"name class fromto {PLACE}", "group material mesh rgba size type user")
BODIES = {
    "body": Element(
        f"name childclass {PLACE}",
        "user simple fuse",
        refused={
            "gravcomp": Refused("gravity acts on all of a robot"),
            "mocap": Refused("bodies move by joints here", ("false",)),
            "sleep": Refused("a body at rest is simulated, too", ("auto", "never", "allowed")),
        },
        inner=None,
    ),
    "inertial": Element(f"mass diaginertia fullinertia {PLACE}"),
    "joint": JOINT,
    "freejoint": Element("name align", "group"),
    "geom": GEOM,
    "site": SITE,
    "camera": UNREAD,
    "light": UNREAD,
}
# The elements by the one that they are in.
TABLE: dict[str, dict[str, Element]] = {
    "mujoco": {
        "compiler": Element(
            "angle eulerseq inertiafromgeom autolimits alignfree",
            "assetdir meshdir texturedir strippath discardvisual fusestatic fitaabb usethread conflict passthrough"
            " savecanonical savecompiled saveinertial",
            refused={
                "coordinate": Refused("places are those in the body around, as in MuJoCo since 2.3.3", ("local",)),
                "boundmass": STATED,
                "boundinertia": STATED,
                "settotalmass": STATED._replace(unless=("-1", "0")),
                "balanceinertia": STATED._replace(unless=("false",)),
                "inertiagrouprange": Refused("all geoms of a body have mass here; give mass 0 to the others", ("0 5",)),
            },
            inner="lengthrange",
        ),
        "option": Element(
            "gravity actuatorgroupdisable",
            "timestep integrator cone impratio jacobian solver iterations tolerance ls_iterations ls_tolerance"
            " noslip_iterations noslip_tolerance ccd_iterations ccd_tolerance sdf_iterations sdf_initpoints"
            # Wind needs a medium, magnetic fields a magnetometer, and the last four a flag that is refused.
            " sleep_tolerance wind magnetic o_margin o_solref o_solimp o_friction",
            refused={"density": NO_MEDIUM, "viscosity": NO_MEDIUM},
            inner="flag",
        ),
        "default": Element(
            "class",
            inner=" ".join(
                ("default geom joint site camera light mesh material texture pair equality tendon", *KINDS_OF_ACTUATORS)
            ),
        ),
        "worldbody": Element("childclass", inner=None),
        "keyframe": Element(inner="key"),
        "contact": Element(inner="pair exclude"),
        **dict.fromkeys(("actuator", "sensor"), INNER),
        **dict.fromkeys(("size", "visual", "statistic", "asset", "custom"), UNREAD),
    },
    "compiler": {"lengthrange": UNREAD},
    "option": {
        "flag": Element(
            "gravity actuation spring damper frictionloss limit clampctrl",
            "equality warmstart filterparent refsafe sensor midphase nativeccd island eulerdamp autoreset energy fwdinv"
            " invdiscrete multiccd sleep diagexact ipc",
            refused={
                "contact": Refused("the ground holds the shell here", ("enable",)),
                "constraint": Refused("the ground holds the shell here", ("enable",)),
                "override": Refused("friction is that of the geoms here", ("disable",)),
            },
        )
    },
    "worldbody": BODIES,
    "body": BODIES,
    "actuator": ACTUATORS,
    "keyframe": {
        "key": Element(
            "name time qpos qvel ctrl",
            refused={
                "act": Refused(NO_ACTIVATION),
                **dict.fromkeys(("mpos", "mquat"), Refused("bodies move by joints here", ("left out",))),
            },
        )
    },
    "contact": {
        "pair": Element(idle="name class geom1 geom2 condim friction gap margin solimp solref solreffriction adhesion"),
        "exclude": Element("body1 body2", "name"),
    },
    "sensor": {
        **dict.fromkeys(("accelerometer", "gyro"), _with(SENSOR, "site")),
        **dict.fromkeys(("jointpos", "jointvel"), _with(SENSOR, "joint")),
        "framepos": _with(SENSOR, "objtype objname reftype refname"),
    },
}
# Of an element: nothing that a class could give.
IDENTITY = {"name", "class", "joint", "jointinparent", "lengthrange", "body", *ENDS}


def _without_identity(element: Element) -> Element:
    read, idle = (
        " ".join(name for name in names.split() if name not in IDENTITY) for names in (element.read, element.idle)
    )
    refused = {name: why for name, why in element.refused.items() if name not in IDENTITY}
    return Element(read, idle, element.told, refused)


TABLE["default"] = {
    "default": TABLE["mujoco"]["default"],
    **{
        tag: _without_identity(element)
        for tag, element in {**ACTUATORS, "geom": GEOM, "joint": JOINT, "site": SITE}.items()
    },
}


def check_names(root: ET.Element) -> None:
    """Raises a :class:`MJCFError` for the first attribute that MuJoCo does not have where it stands.

    Elements whose tags are not in the table are left to those who read what they are in.
    """
    for element, kind in _find_elements(root):
        for name in element.attrib:
            if name not in kind.names:
                others = f"its attributes are {', '.join(sorted(kind.names))}" if kind.names else "it has none"
                raise MJCFError(
                    f"Attribute `{name}` of {label(element)} must be one that MuJoCo has"
                    f"{did_you_mean(name, kind.names, others, quote='`')}"
                )


def check_values(root: ET.Element) -> None:
    """Raises a :class:`MJCFError` for the first attribute that acts in MuJoCo and cannot here; classes must have been
    applied.
    """
    for element, kind in _find_elements(root):
        for name, refused in kind.refused.items():
            if element.get(name) is not None:
                _require_idle(element, name, refused)


def notes_of(elements: Iterable[ET.Element]) -> list[str]:
    """Writes a sentence for each of these elements of bodies that has attributes which act in MuJoCo and not here."""
    notes = []
    for element in elements:
        reasons = BODIES[element.tag].told
        names = [f"`{name}`" for name in reasons if element.get(name) is not None]
        if names:
            why, were = next(iter(reasons.values())), "was" if len(names) == 1 else "were"
            notes.append(f"The {all_of(names)} of {label(element)} {were} not imported, because {why}.")
    return notes


def _find_elements(root: ET.Element) -> Iterator[tuple[ET.Element, Element]]:
    """Iterates over the elements that the table has, and raises for those in them that have no place there."""
    # By a list, because a file may be nested more deeply than functions may be.
    waiting = [(root, Element("model", inner=None))]
    while waiting:
        element, kind = waiting.pop()
        yield element, kind
        inner = TABLE.get(element.tag, {})
        for child in reversed(element):
            if kind.inner is not None and child.tag not in kind.inner.split():
                accepted = any_of([f"<{tag}>" for tag in kind.inner.split()]) if kind.inner else "nothing"
                raise MJCFError(
                    f"Element {label(child)} in {label(element)} must be left out, because {NO_COUNTERPART}; accepted "
                    f"there is {accepted}."
                )
            kind_of_child = inner.get(child.tag, UNREAD)
            if kind_of_child is not UNREAD:
                waiting.append((child, kind_of_child))


def _require_idle(element: ET.Element, name: str, refused: Refused) -> None:
    """Raises a :class:`MJCFError` where an attribute has another value than one that does not act."""
    text = " ".join(element.get(name, "").split())
    if refused.unless:
        if text in refused.unless:
            return
        must = any_of([word if word == "left out" else f'"{word}"' for word in refused.unless])
    elif not np.any(numbers(element, name) != 0):
        return
    else:
        must = "0 or left out"
    raise MJCFError(
        f'Attribute `{name}` of {label(element)} must be {must}, because {refused.why}, but it is "{text}".'
    )


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
