"""Reads what a shell carries: bodies without joints as fixed masses, and trees of bodies on joints as mechanisms.

Springs and dampers that a file gives by times and ratios become numbers, as when MuJoCo 3.17 compiles it: both follow
from the inertias of joints where the file has its bodies, with the shell and all other joints free.
"""

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...physics.dynamics.parameters import PointMass
from ...physics.mechanisms import (
    AbstractJoint,
    AbstractJointForce,
    CarriedMass,
    Hinge,
    JointForces,
    Mechanism,
    Slider,
    rigid_body_masses,
)
from ...physics.prescribed.frames import MatrixFrame
from ...physics.prescribed.motion import Fixed
from .elements import (
    MINVAL,
    Frame,
    Inertial,
    MJCFError,
    Settings,
    frame_between,
    frame_of,
    label,
    number,
    numbers,
    refuse_others,
    text_of,
)
from .forces import gear_of, joint_of, law_of, read_springs
from .sensors import Site

IN_BODY = ("inertial", "joint", "geom", "body", "site", "camera", "light")


class Inside(NamedTuple):
    """What a shell carries; ``elements`` are those of all joints, in the order of MuJoCo's and of a state's θ.

    ``sites`` are those of the shell and of all bodies in it, by their names.
    """

    masses: tuple[PointMass, ...]
    mechanisms: tuple[Mechanism, ...]
    elements: tuple[ET.Element, ...]
    sites: dict[str, Site]

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of all joints."""
        return tuple(element.get("name", "") for element in self.elements)


@dataclass
class _Tree:
    """A mechanism while it is read."""

    joints: list[AbstractJoint] = field(default_factory=list)
    masses: list[CarriedMass] = field(default_factory=list)
    elements: list[ET.Element] = field(default_factory=list)


class _Carrier(NamedTuple):
    """What carries a body: a joint of a tree by its index, or the shell, whose tree is None."""

    tree: _Tree | None
    joint: int


@dataclass
class _Reader:
    settings: Settings
    forces: Mapping[str, Sequence[AbstractJointForce]]
    masses: list[PointMass] = field(default_factory=list)
    trees: list[_Tree] = field(default_factory=list)
    sites: dict[str, Site] = field(default_factory=dict)

    def read_bodies(self, shell: ET.Element, outermost: Frame) -> None:
        """Reads the bodies in a shell, which has a frame in the axes of the ball, each after the one that it is in."""
        # By a list, because a file may be nested more deeply than functions may be.
        waiting = [(body, outermost, _Carrier(None, -1)) for body in reversed(shell.findall("body"))]
        while waiting:
            body, outer, carrier = waiting.pop()
            frame, carrier = self._read(body, outer, carrier)
            waiting += [(inner, frame, carrier) for inner in reversed(body.findall("body"))]

    def _read(self, body: ET.Element, outer: Frame, carrier: _Carrier) -> tuple[Frame, _Carrier]:
        """Reads a body, whose parent has the frame ``outer`` in the axes of the ball; returns what the bodies in it are
        on.
        """
        refuse_others(body, IN_BODY, "it has no counterpart here")
        for geom in body.findall("geom"):
            if touches(geom):
                raise MJCFError(
                    f"Element {label(geom)} must have contype and conaffinity 0, because only the shell has contacts "
                    "here."
                )
        frame = outer.then(frame_of(body, self.settings.angles))
        # The joints of one body are a chain: each is on the one before.
        for element in body.findall("joint"):
            carrier = self._on_joint(element, frame, carrier)
        self.read_sites(body, frame, carrier)
        for mass in self._masses(body, frame):
            if carrier.tree is None:
                self.masses.append(PointMass(mass.mass, Fixed(mass.place)))
            else:
                carrier.tree.masses.append(CarriedMass(mass.mass, mass.place, carrier.joint))
        return frame, carrier

    def read_sites(self, body: ET.Element, frame: Frame, carrier: _Carrier) -> None:
        """Reads the sites of a body, which has the ``frame`` in the axes of the ball."""
        tree = carrier.tree
        # By identity: trees with equal contents are two.
        where = [index for index, other in enumerate(self.trees) if other is tree]
        on = f"mechanisms[{where[0]}].joints[{carrier.joint}]" if where else None
        for site in body.findall("site"):
            placed = frame_of(site, self.settings.angles) if site.get("fromto") is None else frame_between(site)[0]
            self.sites[site.get("name", "")] = Site(on, frame.then(placed))

    def _on_joint(self, element: ET.Element, frame: Frame, carrier: _Carrier) -> _Carrier:
        tree = carrier.tree
        if tree is None:
            tree = _Tree()
            self.trees.append(tree)
        before = len(tree.joints) - 1
        name = element.get("name", "")
        drive = sum_forces([*read_springs(element, self.settings), *self.forces.get(name, ())])
        # The joint before is the default, which scenarios do not state.
        on = None if carrier.joint == before else carrier.joint
        tree.joints.append(_joint(element, frame, drive, on))
        tree.elements.append(element)
        return _Carrier(tree, before + 1)

    def _masses(self, body: ET.Element, frame: Frame) -> Iterator[CarriedMass]:
        inertial = self.settings.inertial_of(body)
        if inertial is None:
            return
        # The least that MuJoCo requires of a body that moves; `_add_least` writes it, and it stands for nothing.
        moments = np.where(np.abs(inertial.moments) <= MINVAL, 0.0, inertial.moments)
        if inertial.mass <= MINVAL and not np.any(moments):
            return
        try:
            yield from masses_of(inertial._replace(moments=moments, axes=frame.then(inertial.axes)))
        except ValueError as error:
            raise MJCFError(f"The inertia of {label(body)} is impossible: {error}") from None


def masses_of(inertial: Inertial, joint: int = -1) -> list[CarriedMass]:
    """Returns the masses with this inertia, which a ``joint`` carries: one where it has no moments.

    **Raises:** ``ValueError`` for moments that no body has.
    """
    centre, axes = inertial.axes.shift, MatrixFrame(inertial.axes.turn)
    if not np.any(inertial.moments):
        return [CarriedMass(inertial.mass, centre, joint)]
    return rigid_body_masses(inertial.mass, inertial.moments, centre=centre, frame=axes, joint=joint)


def read_inside(
    shell: ET.Element, frame: Frame, settings: Settings, forces: Mapping[str, Sequence[AbstractJointForce]]
) -> Inside:
    """Reads the masses and mechanisms in a shell, whose element has the ``frame`` in the axes of the ball.

    ``forces`` are those of actuators by the names of their joints.

    **Raises:** :class:`MJCFError` for what a ball with mechanisms does not have.
    """
    reader = _Reader(settings, forces)
    reader.read_sites(shell, frame, _Carrier(None, -1))
    reader.read_bodies(shell, frame)
    elements = tuple(element for tree in reader.trees for element in tree.elements)
    inside = Inside(tuple(reader.masses), tuple(map(_mechanism, reader.trees)), elements, reader.sites)
    names = Counter(name for name in inside.joints if name)
    for name, count in names.items():
        if count > 1:
            raise MJCFError(f'Joints must have names of their own, but {count} are called "{name}".')
    for name in forces:
        if name not in names:
            raise MJCFError(f'Actuators must act on joints in the shell, but one acts on "{name}", which is not there.')
    return inside


def touches(geom: ET.Element) -> bool:
    """Returns whether other geoms may touch a geom."""
    return any(bits_of(geom, name) for name in ("contype", "conaffinity"))


def bits_of(geom: ET.Element, name: str) -> int:
    """Reads the bits of a geom by which MuJoCo decides whether it touches another: its `contype` or `conaffinity`."""
    return int(number(geom, name, 1.0))


def _mechanism(tree: _Tree) -> Mechanism:
    try:
        return Mechanism(tree.joints, tree.masses)
    except ValueError as error:
        which = ", ".join(f'"{element.get("name", "")}"' for element in tree.elements)
        raise MJCFError(f"The bodies on the joints {which} are no mechanism: {error}") from None


def sum_forces(forces: Sequence[AbstractJointForce]) -> AbstractJointForce | None:
    """Returns the sum of forces on a joint, or the only one; None without any."""
    if len(forces) < 2:
        return forces[0] if forces else None
    return JointForces(tuple(forces))


def _joint(element: ET.Element, frame: Frame, drive: AbstractJointForce | None, on: int | None) -> AbstractJoint:
    kind = element.get("type", "hinge")
    axis = frame.turn @ numbers(element, "axis", (0.0, 0.0, 1.0))
    if not np.any(axis != 0):
        raise MJCFError(f"Attribute `axis` of {label(element)} must be a direction, but it is 0.")
    if kind == "hinge":
        return Hinge(axis, frame.of_point(numbers(element, "pos", np.zeros(3))), drive, on)
    if kind == "slide":
        return Slider(axis, drive, on)
    raise MJCFError(f'Element {label(element)} must be a hinge or a slide, but its type is "{kind}".')


PLANAR = (0, 2, 4)  # of the six velocities of a body, those that a disk has


def replace_ratios(inside: Inside, actuators: list[ET.Element], inertial: Inertial, planar: bool) -> bool:
    """Gives joints with a `springdamper`, and actuators with a ratio of damping, the numbers that these stand for.

    - ``inertial``: that of the shell, in the axes in which ``inside`` is.
    - ``planar``: whether the shell is that of a disk.

    Returns whether there were any.

    **Raises:** :class:`MJCFError` for a time or a ratio that is not positive, and for an actuator with a damping and a
    ratio of it.
    """
    servos = [actuator for actuator in actuators if _ratio(actuator)]
    if not servos and not any(map(_springdamper, inside.elements)):
        return False
    inertias = _inertias(inertial, inside, planar)
    for joint, inertia in zip(inside.elements, inertias, strict=True):
        time, ratio = _springdamper(joint) or (np.inf, np.inf)
        if np.isfinite(time):
            joint.set("stiffness", text_of(inertia / (time * ratio) ** 2))
            joint.set("damping", text_of(2 * inertia / time))
            del joint.attrib["springdamper"]
    by_name = dict(zip(inside.joints, inertias, strict=True))
    for actuator in servos:
        _set_damping(actuator, by_name[joint_of(actuator)])
    return True


def _springdamper(joint: ET.Element) -> tuple[float, float] | None:
    """Reads the time constant and the damping ratio of a joint, None where it has none."""
    if joint.get("springdamper") is None:
        return None
    time, ratio = map(float, numbers(joint, "springdamper", count=2))
    if time == ratio == 0:
        return None
    if time <= 0 or ratio <= 0:
        raise MJCFError(
            f"Attribute `springdamper` of {label(joint)} must be a time and a ratio that are positive, but it is "
            f'"{joint.get("springdamper")}".'
        )
    return time, ratio


def _ratio(actuator: ET.Element) -> float:
    """Reads the ratio of damping of a servo, 0 where it has none."""
    if actuator.tag == "position" and actuator.get("dampratio") is not None:
        ratio = float(numbers(actuator, "dampratio", count=1)[0])
        if ratio and actuator.get("kv") is not None:
            raise MJCFError(f"Element {label(actuator)} must have `kv` or `dampratio`, but it has both.")
        return ratio
    if actuator.tag != "general":
        return 0.0
    law = law_of(actuator)
    return -law.damping if law.is_servo and law.damping < 0 else 0.0


def _set_damping(actuator: ET.Element, inertia: float) -> None:
    ratio, law, gear = _ratio(actuator), law_of(actuator), gear_of(actuator)
    damping = 2 * ratio * np.sqrt(law.stiffness * inertia) / abs(gear) if gear else 0.0
    if actuator.tag == "position":
        del actuator.attrib["dampratio"]
        actuator.set("kv", text_of(damping))
    else:
        actuator.set("biasprm", text_of(0.0, -law.stiffness, -damping))


def _inertias(inertial: Inertial, inside: Inside, planar: bool) -> Float[np.ndarray, " joints"]:
    """Computes the force that an acceleration of 1 takes at each joint where all else is free, in the order of
    ``inside``.
    """
    n = len(inside.joints)
    M = np.zeros((6 + n, 6 + n))
    turn = inertial.axes.turn
    M[3:6, 3:6] = turn @ np.diag(inertial.moments) @ turn.T
    for mass, velocities in [(inertial.mass, _of_shell(inertial.axes.shift, n)), *_points(inside, n)]:
        M += mass * velocities.T @ velocities
    freedoms = [*(PLANAR if planar else range(6)), *range(6, 6 + n)]
    return 1 / np.diag(np.linalg.inv(M[np.ix_(freedoms, freedoms)]))[len(freedoms) - n :]


def _points(inside: Inside, n: int) -> Iterator[tuple[float, Float[np.ndarray, "3 dofs"]]]:
    """Iterates over the masses in a shell, and their velocities by those of the shell and of all joints."""
    for mass in inside.masses:
        yield float(mass.mass), _of_shell(_place(mass), n)
    before = 6
    for mechanism in inside.mechanisms:
        columns = [_column(joint) for joint in mechanism.joints]
        for mass, place, link in zip(mechanism.mass, mechanism.place, mechanism.carrier, strict=True):
            velocities = _of_shell(np.asarray(place), n)
            for a in mechanism.carriers(link):
                slide, turn, centre = columns[a]
                velocities[:, before + a] = slide + np.cross(turn, np.asarray(place) - centre)
            yield float(mass), velocities
        before += mechanism.n_joints


def _column(joint: object) -> tuple[Float[np.ndarray, "3"], ...]:
    """Returns the velocity, the angular velocity and the centre of a joint at a rate of 1."""
    assert isinstance(joint, Hinge | Slider)
    axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
    zero = np.zeros(3)
    return (zero, axis, np.asarray(joint.point)) if isinstance(joint, Hinge) else (axis, zero, zero)


def _place(mass: PointMass) -> Float[np.ndarray, "3"]:
    assert isinstance(mass.motion, Fixed)
    return np.asarray(mass.motion.position)


def _of_shell(place: Float[np.ndarray, "3"], n: int) -> Float[np.ndarray, "3 dofs"]:
    """Returns the velocity of a point of the shell by the velocity, the angular velocity and the rates of n joints."""
    x, y, z = place
    return np.hstack([np.eye(3), [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]], np.zeros((3, n))])
