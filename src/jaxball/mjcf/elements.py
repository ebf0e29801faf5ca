"""Elements of MuJoCo's files: the numbers in their attributes, defaults of their classes, frames and inertias.

The readers of :mod:`jaxball.urdf` use the frames and inertias as well.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..interface.wording import UserError

MINVAL = 1e-15  # MuJoCo's mjMINVAL: the mass and the moments that it requires of a link that moves
ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
MAIN = "main"
IN_BODIES = ("geom", "joint", "site")
SHARED = ("ctrlrange", "ctrllimited", "forcerange", "forcelimited", "gear", "class")  # by all kinds of actuators
Attributes = Mapping[str, str]
Class = dict[str, dict[str, str]]  # the attributes by the tag


class MJCFError(UserError):
    """A robot cannot be written as MJCF, or read from it; the message is one sentence that names the part."""


def text_of(*values: Any) -> str:
    """Formats numbers as the text of an attribute, with every digit."""
    flat = np.concatenate([np.ravel(np.asarray(value, dtype=float)) for value in values])
    return " ".join(repr(float(x) + 0.0).removesuffix(".0") for x in flat)  # + 0.0 turns −0 into 0


def add(parent: ET.Element, tag: str, **attributes: Any) -> ET.Element:
    """Adds a new element to ``parent``; numbers become text, and attributes that are None are left out."""
    values = {name: value for name, value in attributes.items() if value is not None}
    texts = {name: value if isinstance(value, str) else text_of(value) for name, value in values.items()}
    return ET.SubElement(parent, tag, texts)


def label(element: ET.Element) -> str:
    """Names an element as sentences do: by its tag and its name."""
    name = element.get("name")
    return f"<{element.tag}>" if name is None else f'<{element.tag} name="{name}">'


def numbers(
    element: ET.Element,
    name: str,
    default: Sequence[float] | Float[np.ndarray, " n"] | None = None,
    count: int | None = None,
) -> Float[np.ndarray, " n"]:
    """Reads the numbers of an attribute: ``count`` of them; without a ``count``, as many as the ``default`` has, unless
    that is None.

    **Raises:** :class:`MJCFError` where they are missing without a default, or something else.
    """
    text = element.get(name)
    count = len(default) if count is None and default is not None else count
    must = f"{count} numbers" if count != 1 else "a number"
    if text is None:
        if default is None:
            raise MJCFError(f"Element {label(element)} must have `{name}`, {must}, but it is missing.")
        return np.asarray(default, dtype=float)
    try:
        values = np.asarray([float(word) for word in text.split()])
    except ValueError:
        # Not finite, for the sentence below.
        values = np.asarray([np.nan])
    if not np.isfinite(values).all() or (count is not None and len(values) != count):
        raise MJCFError(f'Attribute `{name}` of {label(element)} must be {must}, but it is "{text}".')
    return values


def number(element: ET.Element, name: str, default: float | None = None) -> float:
    """Reads the number of an attribute; raises as :func:`numbers`."""
    return float(numbers(element, name, None if default is None else (default,), 1)[0])


def refuse_others(element: ET.Element, tags: Iterable[str], why: str) -> None:
    """Raises a :class:`MJCFError` for the first element in ``element`` whose tag is not ``tags``."""
    tags = tuple(tags)
    for child in element:
        if child.tag not in tags:
            accepted = ", ".join(f"<{tag}>" for tag in tags)
            raise MJCFError(
                f"Element {label(child)} in {label(element)} must be left out, because {why}; accepted there are "
                f"{accepted}."
            )


def refuse_values(element: ET.Element, names: Iterable[str], why: str) -> None:
    """Raises a :class:`MJCFError` for the first of these attributes that has a number other than 0."""
    for name in names:
        if element.get(name) is not None and np.any(numbers(element, name) != 0):
            raise MJCFError(
                f"Attribute `{name}` of {label(element)} must be 0 or left out, because {why}, but it is "
                f'"{element.get(name)}".'
            )


def refuse_what_holds(joint: ET.Element) -> None:
    """Raises a :class:`MJCFError` where a joint between the world and the shell has a force of its own."""
    names = "damping", "armature", "frictionloss", "stiffness"
    refuse_values(joint, names, "nothing holds the shell but the plane here")


class Frame(NamedTuple):
    """A frame in another one: a point x of it is at ``turn`` x + ``shift``."""

    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]

    def of_point(self, x: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        return self.turn @ x + self.shift

    def then(self, inner: "Frame") -> "Frame":
        """Returns the frame that is ``inner`` in this one."""
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
    """Reads the frame of an element in the frame of its parent; raises a :class:`MJCFError` for numbers that are not
    one.
    """
    return Frame(_turn(element, angles), numbers(element, "pos", np.zeros(3)))


def _turn(element: ET.Element, angles: Angles) -> Float[np.ndarray, "3 3"]:
    turns = [name for name in ORIENTATIONS if element.get(name) is not None]
    if not turns:
        return np.eye(3)
    if len(turns) > 1:
        raise MJCFError(
            f"Element {label(element)} must have one orientation, but it has `{turns[0]}` and `{turns[1]}`."
        )
    name, count = turns[0], {"quat": 4, "axisangle": 4, "xyaxes": 6}.get(turns[0], 3)
    values = numbers(element, name, count=count)
    # MuJoCo's scalar is first, SciPy's last. A scalar alone is exact at any norm; `_is_at` compares exactly.
    if name == "quat" and np.any(values != 0):
        return Rotation.from_quat(np.roll(values, -1)).as_matrix() if np.any(values[1:] != 0) else np.eye(3)
    if name == "axisangle" and np.any(values[:3] != 0):
        axis = values[:3] / np.linalg.norm(values[:3])
        return Rotation.from_rotvec(axis * values[3] * angles.unit).as_matrix()
    if name == "euler":
        return Rotation.from_euler(angles.sequence, values * angles.unit).as_matrix()
    # MuJoCo, too, takes y only as far as it is across x.
    if name == "xyaxes":
        x = values[:3] / np.linalg.norm(values[:3])
        y = values[3:] - (values[3:] @ x) * x
        return np.column_stack([x, y / np.linalg.norm(y), np.cross(x, y / np.linalg.norm(y))])
    raise MJCFError(
        f"Attribute `{name}` of {label(element)} must be a `quat`, `axisangle`, `xyaxes` or `euler` that is not 0, "
        f'but it is "{element.get(name)}".'
    )


def read_inertial(body: ET.Element, angles: Angles) -> Inertial | None:
    """Reads the inertia that a body states, in its own frame; None if it states none."""
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
    """Computes the principal moments of an inertia, and its principal axes as the columns of a rotation."""
    # Left as it is: `eigh` would sort the moments, and exchange the axes of a body that has its own already.
    if np.array_equal(inertia, np.diag(np.diag(inertia))):
        return np.diag(inertia), np.eye(3)
    moments, axes = np.linalg.eigh(inertia)
    # Eigenvectors may be left-handed, which is no rotation.
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return moments, axes


def combine(parts: Sequence[Inertial]) -> Inertial:
    """Combines the inertia of one or more bodies that are fixed to each other."""
    mass = sum(part.mass for part in parts)
    centre = np.sum([part.mass * part.axes.shift for part in parts], axis=0) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        turn, arm = part.axes.turn, part.axes.shift - centre
        # Steiner: each about the common centre.
        inertia += turn @ np.diag(part.moments) @ turn.T + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    moments, axes = principal(inertia)
    return Inertial(mass, Frame(axes, centre), moments)


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
        raise MJCFError(f"Element {label(element)} within another one must have a `class`, but it has none.")
    defaults = {tag: dict(attributes) for tag, attributes in inherited.items()}
    for child in element:
        if child.tag != "default":
            defaults[child.tag] = defaults.get(child.tag, {}) | child.attrib
    classes[name] = defaults
    # Elements that name no class have the outermost one, whatever its name is.
    if otherwise is not None:
        classes[MAIN] = defaults
    for child in element.findall("default"):
        _collect(child, None, defaults, classes)


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
        raise MJCFError(f'Attribute `class` of {label(element)} must be a class of <default>, but it is "{name}".')
    return classes[name]


def _of_actuator(element: ET.Element, defaults: Class) -> Attributes:
    """Returns the defaults of an actuator, of which MuJoCo has one set for all kinds."""
    attributes: dict[str, str] = {}
    for tag in ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion"):
        for name, value in defaults.get(tag, {}).items():
            if tag != element.tag and name not in SHARED:
                raise MJCFError(
                    f"Attribute `{name}` of <{tag}> in <default> must be left out, because {label(element)} is an "
                    f"actuator of another kind; give it to each <{tag}>."
                )
            attributes[name] = value
    return attributes


def _complete(element: ET.Element, defaults: Attributes) -> None:
    """Sets the attributes that an element lacks; one orientation replaces another, as ends do a place."""
    names = set(element.attrib)
    turned = any(name in names for name in (*ORIENTATIONS, "fromto"))
    for name, value in defaults.items():
        if name not in names and not (turned and name in (*ORIENTATIONS, "fromto")):
            element.set(name, value)
    element.attrib.pop("class", None)


def _make_free(joint: ET.Element) -> None:
    refuse_what_holds(joint)
    joint.tag = "freejoint"
