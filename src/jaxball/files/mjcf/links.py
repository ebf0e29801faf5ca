"""Writes masses and mechanisms as MJCF bodies inside that of the shell, each with the shell's origin and axes.

So every axis, point and place has the same numbers as in jaxball. A link is a body whose only inertia is the least that
MuJoCo requires; the masses that it carries are bodies fixed in it.
"""

import functools
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeGuard, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...physics.body import System
from ...physics.dynamics.parameters import PointMass
from ...physics.mechanisms import AbstractJoint, Carriage, Hinge, Mechanism, Slider
from ...physics.prescribed.motion import AbstractPrescribedMotion, Fixed, OnRail
from ...physics.prescribed.rails import AbstractRail, Circle, Tube
from ...physics.prescribed.schedules import AbstractSchedule, FunctionSchedule
from .drives import Control, write_drive
from .elements import MINVAL, MJCFError, add

AXES_BY_NAME = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
ON_AXIS = 1e-12  # relative to the radius of a circle
SHOWN_RADIUS = 0.04  # the radius of the sphere that shows a mass, relative to that of the shell


@dataclass
class Links:
    """What is written inside the shell: joints with their schedules, and the controls of actuators.

    - ``actuators``: the element that gets the actuators.
    - ``timestep``: by which the servos of prescribed motions are as stiff as they can be.
    - ``shown``: the radius of the spheres that show masses.
    - ``schedules``: of each joint by its name, None where θ belongs to the state.
    - ``shifts``: of each MJCF body that turns like its part in jaxball: where the part's origin is with every θ at 0.
    """

    actuators: ET.Element
    timestep: float
    shown: float
    schedules: dict[str, AbstractSchedule | None] = field(default_factory=dict)
    controls: list[Control] = field(default_factory=list)
    shifts: dict[str, Float[np.ndarray, "3"]] = field(default_factory=dict)


def write_links(system: System, shell: ET.Element, links: Links) -> None:
    """Adds the masses and mechanisms of a system to the element of its shell.

    **Raises:** :class:`MJCFError` for a motion or a mechanism that MJCF cannot express.
    """
    for index, item in enumerate(system.point_masses):
        _write_mass(item, f"masses[{index}]", shell, links)
    for index, mechanism in enumerate(system.mechanisms):
        if not isinstance(mechanism, Mechanism):
            raise MJCFError(
                f"Mechanism `mechanisms[{index}]` must consist of joints to be written as MJCF, but it is a "
                f"{type(mechanism).__name__}."
            )
        _write_mechanism(mechanism, f"mechanisms[{index}]", shell, links)


def _write_mass(item: PointMass, name: str, shell: ET.Element, links: Links) -> None:
    motion, mass = item.motion, float(item.mass)
    if isinstance(motion, Fixed):
        _add_mass(shell, name, mass, motion.position, links)
        links.shifts[name] = np.zeros(3)
        return
    if not isinstance(motion, AbstractPrescribedMotion):
        raise MJCFError(
            f"Mass `{name}` must move by a schedule to be written as MJCF, but a law accelerates it, whatever force "
            "that takes; put it on a carriage of a mechanism with a PDServo."
        )
    motion = cast(AbstractPrescribedMotion, motion.prepare())
    if isinstance(motion, OnRail) and isinstance(motion.rail, Circle | Tube):
        body, place = add(shell, "body", name=name), np.asarray(motion.rail(jnp.zeros(())))
        _add_least(body)
        joint = _add_guide(body, name, motion.rail, np.zeros(3))
        _add_mass(body, f"{name}.mass", mass, place, links)
        # On a circle θ is an angle, in a tube a length.
        lever = float(motion.rail.radius) if isinstance(motion.rail, Circle) else 1.0
        _drive(joint, motion.schedule, mass * lever**2, links)
        return
    body = add(shell, "body", name=name)
    _add_least(body)
    # Three sliders, one per coordinate, because MuJoCo has no curved guides.
    for axis, direction in enumerate(AXES_BY_NAME.items()):
        joint = add(body, "joint", name=f"{name}.{direction[0]}", type="slide", axis=direction[1])
        _drive(joint, FunctionSchedule(functools.partial(_coordinate, axis), motion), mass, links)
    _add_mass(body, f"{name}.mass", mass, np.zeros(3), links)


def _coordinate(axis: int, t: Float[Array, ""], motion: AbstractPrescribedMotion) -> Float[Array, ""]:
    return motion(t)[axis]


def _write_mechanism(mechanism: Mechanism, name: str, shell: ET.Element, links: Links) -> None:
    still = mechanism.links(jnp.zeros(mechanism.n_joints))
    shifts = [
        np.asarray(link.placement.shift) for link in still
    ]  # by the rails, for the links that their carriages carry
    on = [mechanism.carriers(a)[:-1] for a in range(mechanism.n_joints)]
    bodies: list[ET.Element] = []
    for a, joint in enumerate(mechanism.joints):
        path = f"{name}.joints[{a}]"
        parent = bodies[on[a][-1]] if on[a] else shell
        before = shifts[on[a][-1]] if on[a] else np.zeros(3)
        body = add(parent, "body", name=path)
        _add_least(body)
        element = _add_joint(body, path, joint, before)
        # Everything further out, too: the servo moves it all.
        carried = [i for i, link in enumerate(mechanism.carrier) if a in mechanism.carriers(link)]
        places = np.asarray(mechanism.place)[carried] + np.stack([shifts[mechanism.carrier[i]] for i in carried])
        _check_circle(mechanism, a, path)
        _drive(element, joint.drive, _inertia(element, np.asarray(mechanism.mass)[carried], places), links)
        masses = {f"{name}.masses[{i}]": i for i, link in enumerate(mechanism.carrier) if link == a}
        for mass, i in masses.items():
            _add_mass(body, mass, float(mechanism.mass[i]), np.asarray(mechanism.place[i]) + shifts[a], links)
        # A hinge turns what a carriage on a circle would carry along without a turn, and sensors with it.
        if not _is_on_circle(joint):
            links.shifts |= {path: shifts[a], **dict.fromkeys(masses, np.zeros(3))}
        bodies.append(body)


def _drive(joint: ET.Element, drive: Any, inertia: float, links: Links) -> None:
    name = joint.get("name", "")
    links.schedules[name] = drive if isinstance(drive, AbstractSchedule) else None
    drive = drive.prepare() if isinstance(drive, AbstractSchedule) else drive
    links.controls += write_drive(drive, joint, links.actuators, inertia, links.timestep)


def _add_joint(body: ET.Element, name: str, joint: AbstractJoint, before: Float[np.ndarray, "3"]) -> ET.Element:
    if isinstance(joint, Hinge):
        return add(body, "joint", name=name, type="hinge", axis=joint.axis, pos=np.asarray(joint.point) + before)
    if isinstance(joint, Slider):
        return add(body, "joint", name=name, type="slide", axis=joint.axis)
    if isinstance(joint, Carriage):
        return _add_guide(body, name, joint.rail, before)
    raise MJCFError(
        f"Joint `{name}` must be a Hinge, a Slider or a Carriage to be written as MJCF, but it is a "
        f"{type(joint).__name__}."
    )


def _add_guide(body: ET.Element, name: str, rail: AbstractRail, before: Float[np.ndarray, "3"]) -> ET.Element:
    """Adds a circle as the hinge about its axis, and a tube as a slider."""
    if isinstance(rail, Tube):
        return add(body, "joint", name=name, type="slide", axis=rail.direction)
    if isinstance(rail, Circle):
        pos = np.asarray(rail.centre) + before
        # Minus the second axis, about which the rail's angle θ turns from its first axis to its third.
        return add(body, "joint", name=name, type="hinge", axis=-rail.frame.matrix()[:, 1], pos=pos)
    raise MJCFError(
        f"Joint `{name}` must be on a Circle or a Tube to be written as MJCF, which has no curved guides, but it is on "
        f"a {type(rail).__name__}."
    )


def _check_circle(mechanism: Mechanism, a: int, name: str) -> None:
    """Raises unless a carriage on a circle carries nothing that the hinge in its place would turn."""
    joint = mechanism.joints[a]
    if not _is_on_circle(joint):
        return
    inner = [b for b in range(mechanism.n_joints) if a in mechanism.carriers(b)[:-1]]
    assert isinstance(joint.rail, Circle)
    normal = np.asarray(joint.rail.frame.matrix())[:, 1]
    aside = [mechanism.place[i] for i, link in enumerate(mechanism.carrier) if link == a]
    off = [np.linalg.norm(np.cross(place, normal)) > ON_AXIS * float(joint.rail.radius) for place in aside]
    if inner or any(off):
        what = f"joints[{inner[0]}]" if inner else "a mass beside the rail"
        raise MJCFError(
            f"Joint `{name}` must carry only masses on its circle to be written as MJCF, where a hinge stands for the "
            f"circle and turns what it carries, but it carries {what}."
        )


def _is_on_circle(joint: AbstractJoint) -> TypeGuard[Carriage]:
    return isinstance(joint, Carriage) and isinstance(joint.rail, Circle)


def _inertia(joint: ET.Element, m: Float[np.ndarray, " n"], places: Float[np.ndarray, "n 3"]) -> float:
    """Computes the inertia of masses against a rate of a joint."""
    if joint.get("type") == "slide":
        return float(np.sum(m))
    # From the element, where a hinge and a circle look alike.
    axis = np.fromstring(joint.get("axis", ""), sep=" ")
    arms = places - np.fromstring(joint.get("pos", ""), sep=" ")
    return float(np.sum(m * np.sum(np.cross(axis / np.linalg.norm(axis), arms) ** 2, axis=-1)))


def _add_mass(body: ET.Element, name: str, mass: float, place: Sequence[float] | Any, links: Links) -> None:
    child = add(body, "body", name=name, pos=place)
    # Without a joint of its own MuJoCo lets it be a point, without moments.
    add(child, "inertial", pos=np.zeros(3), mass=mass, diaginertia=np.zeros(3))
    add(child, "geom", type="sphere", size=links.shown, contype="0", conaffinity="0", rgba="0.8 0.3 0.1 1")


def _add_least(body: ET.Element) -> None:
    add(body, "inertial", pos=np.zeros(3), mass=MINVAL, diaginertia=(MINVAL,) * 3)
