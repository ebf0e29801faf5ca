"""Computes springs and dampers that a file gives by times and ratios, of which MuJoCo makes numbers as it compiles.

Both follow from the inertias of joints where the file has its bodies, with the shell and all other joints free, as in
MuJoCo 3.17.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ..physics.dynamics.parameters import PointMass
from ..physics.mechanisms import Hinge, Slider
from ..physics.prescribed.motion import Fixed
from .elements import Inertial, MJCFError, label, numbers, text_of
from .forces import Law, gear_of, joint_of, law_of
from .inside import Inside

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
        actuator.set("biasprm", text_of(*_bias(law._replace(damping=damping))))


def _bias(law: Law) -> tuple[float, float, float]:
    return 0.0, -law.stiffness, -law.damping


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
