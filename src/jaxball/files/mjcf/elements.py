"""Elements of MuJoCo's files: the numbers in their attributes, frames and inertias, and what holds for a whole file.

A file is read from its path or its text. Where a body states no inertia, it is that of its geoms, as in MuJoCo; what
<compiler> and <option> say are its settings. The readers of :mod:`jaxball.files.urdf` use elements as well.
"""

import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...interface.arguments import refusal
from ...interface.wording import UserError

MINVAL = 1e-15  # MuJoCo's mjMINVAL: the mass and the moments that it requires of a link that moves
ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
LIMITS = "the range of a joint of MuJoCo is held by a law of its own, not by stiffness and damping"


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
    count = len(default) if count is None and default is not None else count
    return read_numbers(element, name, label(element), default, count, MJCFError)


def read_numbers(
    element: ET.Element,
    name: str,
    where: str,
    default: Sequence[float] | Float[np.ndarray, " n"] | None,
    count: int | None,
    error: type[UserError],
) -> Float[np.ndarray, " n"]:
    """Reads the numbers of an attribute of an element, which is ``where``: ``count`` of them, if that is known.

    **Raises:** ``error`` where they are missing without a default, or something else.
    """
    text, must = element.get(name), f"{count} numbers" if count != 1 else "a number"
    if text is None:
        if default is None:
            raise error(f"Element {where} must have `{name}`, {must}, but it is missing.")
        return np.asarray(default, dtype=float)
    try:
        values = np.asarray([float(word) for word in text.split()])
    except ValueError:
        # Not finite, for the sentence below.
        values = np.asarray([np.nan])
    if not np.isfinite(values).all() or (count is not None and len(values) != count):
        raise error(f'Attribute `{name}` of {where} must be {must}, but it is "{text}".')
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
    names = "damping", "armature", "frictionloss", "stiffness", "springdamper"
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
    """The unit of angles in rad, and the axes of Euler's angles: x, y, z if they turn, too, and capitals if not."""

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


def frame_between(element: ET.Element) -> tuple[Frame, float]:
    """Reads the frame of an element that is between two points, and half their distance.

    It is in the middle of the two, and its third axis points from the second to the first.

    **Raises:** :class:`MJCFError` for two points that are one.
    """
    ends = numbers(element, "fromto", count=6).reshape(2, 3)
    along = ends[0] - ends[1]
    if not np.any(along != 0):
        raise MJCFError(f"Attribute `fromto` of {label(element)} must be two points, but both are the same.")
    return Frame(_turn_to(along), ends.mean(axis=0)), float(np.linalg.norm(along)) / 2


def _turn_to(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Computes the least rotation that takes the third axis to a direction, about the first if that is opposite."""
    x, y, z = direction / np.linalg.norm(direction)
    axis = np.array([-y, x, 0.0]) if x or y else np.array([1.0, 0.0, 0.0])
    return Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.arctan2(np.hypot(x, y), z)).as_matrix()


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
        return _turn_by_euler(angles.sequence, values * angles.unit)
    if name == "zaxis" and np.any(values != 0):
        return _turn_to(values)
    # MuJoCo, too, takes y only as far as it is across x.
    across = np.cross(values[:3], values[3:]) if name == "xyaxes" else np.zeros(3)
    if np.any(across != 0):
        x, z = values[:3] / np.linalg.norm(values[:3]), across / np.linalg.norm(across)
        return np.column_stack([x, np.cross(z, x), z])
    raise MJCFError(
        f'Attribute `{name}` of {label(element)} must be an orientation, with axes that are not 0, but it is "'
        f'{element.get(name)}".'
    )


def _turn_by_euler(sequence: str, angles: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    # One by one, because MuJoCo lets axes that turn and axes that do not follow each other, and the same one twice.
    turn = np.eye(3)
    for axis, angle in zip(sequence, angles, strict=True):
        single = Rotation.from_euler(axis.lower(), angle).as_matrix()
        turn = turn @ single if axis.islower() else single @ turn
    return turn


def _read_inertial(body: ET.Element, angles: Angles) -> Inertial | None:
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


def _part(geom: ET.Element, angles: Angles) -> Inertial | None:
    # Before its shape: what has no mass may be a mesh.
    if geom.get("mass") is not None and number(geom, "mass") == 0:
        return None
    density, kind = number(geom, "density", DENSITY), geom.get("type", "sphere")
    if geom.get("mass") is None and density == 0:
        return None
    if density < 0:
        raise MJCFError(f"Attribute `density` of {label(geom)} must not be negative, but it is {density:g}.")
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


SWITCHES = ("enable", "disable")
AXES = set("xyzXYZ")


class Settings(NamedTuple):
    """What holds for a whole file.

    - ``angles``: how it gives angles.
    - ``from_geoms``: whether inertias are those of geoms: true, false, or auto, where a body states none.
    - ``autolimits``: whether a range is a limit without a word that says so.
    - ``gravity``: the acceleration.
    - ``disabled``: the flags of ``<option>`` that are disabled.
    - ``idle_groups``: the groups of actuators that exert no force.
    - ``alignfree``: whether a free body without bodies in it moves in its principal axes.
    """

    angles: Angles
    from_geoms: str
    autolimits: bool
    gravity: Float[np.ndarray, "3"]
    disabled: frozenset[str]
    idle_groups: frozenset[int]
    alignfree: bool

    def inertial_of(self, body: ET.Element) -> Inertial | None:
        """Returns the inertia of a body in its own frame, None if it has none.

        **Raises:** :class:`MJCFError` for a geom whose mass is not computed here.
        """
        stated = None if self.from_geoms == "true" else _read_inertial(body, self.angles)
        if stated or self.from_geoms == "false":
            return stated
        parts = [part for part in (_part(geom, self.angles) for geom in body.findall("geom")) if part is not None]
        return combine(parts) if parts else None

    def limits(self, element: ET.Element, what: str) -> tuple[float, float] | None:
        """Reads the limits of an element: of its control (``ctrl``), its force, or of a joint (an empty ``what``).

        None where it has none, or does not keep to them.

        **Raises:** :class:`MJCFError` for a range that is none, and where the file does not say whether it is a limit.
        """
        text = element.get(f"{what}range")
        word = word_of(element, f"{what}limited", ("auto", "true", "false"))
        if word == "false" or (text is None and word == "auto"):
            return None
        low, high = numbers(element, f"{what}range", count=2)
        if word == "auto" and not self.autolimits:
            raise MJCFError(
                f"Element {label(element)} must have `{what}limited` beside `{what}range`, because the file has "
                "`autolimits` false, but it is missing."
            )
        if low < high:
            return float(low), float(high)
        # As in MuJoCo, where "0 0" says that there is no limit.
        if word == "auto":
            return None
        raise MJCFError(f'Attribute `{what}range` of {label(element)} must increase, but it is "{text}".')


def read_settings(root: ET.Element) -> Settings:
    """Reads the settings of a file; what a later element states replaces what an earlier one does.

    **Raises:** :class:`MJCFError` for words that are none of MuJoCo's.
    """
    angle, sequence, from_geoms, autolimits, alignfree = "degree", "xyz", "auto", "true", "false"
    for compiler in root.findall("compiler"):
        from_geoms = word_of(compiler, "inertiafromgeom", ("auto", "true", "false"), from_geoms)
        angle = word_of(compiler, "angle", ("degree", "radian"), angle)
        autolimits = word_of(compiler, "autolimits", ("true", "false"), autolimits)
        alignfree = word_of(compiler, "alignfree", ("true", "false"), alignfree)
        sequence = compiler.get("eulerseq", sequence)
        if len(sequence) != 3 or not set(sequence) <= AXES:
            raise MJCFError(
                "Attribute `eulerseq` of <compiler> must be three of the letters x, y, z, in capitals for fixed axes, "
                f'but it is "{sequence}".'
            )
    gravity, flags, idle_groups = np.array([0.0, 0.0, -9.81]), dict[str, str](), frozenset[int]()
    for option in root.findall("option"):
        gravity = numbers(option, "gravity", gravity)
        groups = option.get("actuatorgroupdisable")
        idle_groups = idle_groups if groups is None else frozenset(map(int, numbers(option, "actuatorgroupdisable")))
        for element in option.findall("flag"):
            flags |= {name: word_of(element, name, SWITCHES) for name in element.attrib}
    disabled = frozenset(name for name, word in flags.items() if word == "disable")
    if "gravity" in disabled:
        gravity = np.zeros(3)
    unit = 1.0 if angle == "radian" else np.pi / 180
    angles, switches = Angles(unit, sequence), (autolimits == "true", gravity, disabled, idle_groups)
    return Settings(angles, from_geoms, *switches, alignfree == "true")


def word_of(element: ET.Element, name: str, words: tuple[str, ...], default: str | None = None) -> str:
    """Reads an attribute that is one of some words; the first of them, unless a default is given, where it is missing.

    **Raises:** :class:`MJCFError` for another word.
    """
    word = element.get(name, words[0] if default is None else default)
    if word not in words:
        listed = ", ".join(f'"{choice}"' for choice in words)
        raise MJCFError(f'Attribute `{name}` of {label(element)} must be one of {listed}, but it is "{word}".')
    return word


Source = str | os.PathLike[str]


def read_xml(source: Source, kind: str, tag: str, error: type[UserError]) -> ET.Element:
    """Reads the root of an XML file, from its path or its text, which has a ``<`` in it.

    - ``kind``: what the file is, such as "an MJCF file".
    - ``tag``: that its root must have.

    **Raises:** ``error`` where there is no such file, and for a text that is no XML, that declares entities, or that
    has another root.
    """
    text = _text_of(source, kind, error)
    # A short file of nested entities can grow to gigabytes while it is parsed.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise error("The file must have no document type and no entities, but it declares some; leave them out.")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError) as cause:
        raise error(f"The file must be XML, but it is not: {cause}.") from None
    if root.tag != tag:
        raise error(f"The file must have <{tag}> as its root, but it has {label(root)}.")
    return root


def _text_of(source: Source, kind: str, error: type[UserError]) -> str:
    must = f"the path of {kind}, or its text"
    if not isinstance(source, str | os.PathLike):
        raise refusal("source", must, source)
    # No path of a robot has this letter, and every XML file does.
    if isinstance(source, str) and ("<" in source or "\n" in source):
        return source.removeprefix("\ufeff")
    try:
        return Path(source).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as cause:
        reason = cause.strerror if isinstance(cause, OSError) else "it is not UTF-8 text"
        raise error(f'Argument `source` must be {must}, but it is "{source}" ({reason}).') from None
