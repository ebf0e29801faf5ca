"""Writes and reads the drives of joints: springs and dampers as attributes of MuJoCo's joints, others as actuators."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeGuard

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..physics.mechanisms import (
    AbstractJointForce,
    Accelerated,
    Damper,
    Drive,
    EndStops,
    JointForces,
    JointFriction,
    Motor,
    PDServo,
    SpeedLimitedMotor,
    Spring,
)
from ..physics.prescribed.schedules import AbstractSchedule, ConstantRate
from .elements import Angles, MJCFError, add, label, number, numbers, refuse_values

Signal = Callable[[Float[Array, ""]], Float[Array, ""]]
KEEPING = 0.2  # of a servo that stands for a prescribed motion: its natural frequency times the time step
LIMITS = "the range of a joint of MuJoCo is held by a law of its own, not by stiffness and damping"


class Control(NamedTuple):
    """The control of one actuator: its name, and its value as a function of time."""

    actuator: str
    signal: Signal


def write_drive(
    drive: Drive, joint: ET.Element, actuators: ET.Element, inertia: float, timestep: float
) -> list[Control]:
    """Adds a drive to the element of a joint, or to the actuators, and returns the controls of the latter.

    A schedule becomes a servo that is critically damped for the ``inertia`` that the joint moves.

    **Raises:** :class:`MJCFError` for a drive that MJCF cannot express.
    """
    name = joint.get("name", "")
    if isinstance(drive, AbstractSchedule):
        return [write_servo(name, name, drive, actuators, inertia, timestep)]
    if isinstance(drive, Accelerated):
        raise MJCFError(
            f"Joint `{name}` must be moved by forces or a schedule to be written as MJCF, but a law accelerates it, "
            "whatever force that takes; give it a PDServo."
        )
    forces = () if drive is None else drive.terms if isinstance(drive, JointForces) else (drive,)
    _write_springs([force for force in forces if isinstance(force, Spring)], joint)
    frictions = [force for force in forces if _is_plain(force)]
    dampers = [float(force.coefficient) for force in forces if isinstance(force, Damper)]
    _write_dampers([*dampers, *(float(friction.viscous) for friction in frictions)], joint)
    if any(float(friction.kinetic) > 0 for friction in frictions):
        joint.set("frictionloss", repr(sum(float(friction.kinetic) for friction in frictions)))
    stops = [force for force in forces if isinstance(force, EndStops)]
    if stops:
        # The innermost stops are those that the joint reaches.
        joint.set("range", f"{float(max(s.lower for s in stops))!r} {float(min(s.upper for s in stops))!r}")
    of_joint = Spring | Damper | EndStops
    others = [force for force in forces if not isinstance(force, of_joint) and not _is_plain(force)]
    names = [name] if len(others) == 1 else [f"{name}.force[{index}]" for index in range(len(others))]
    return [_write_actuator(of_joint, name, force, actuators) for of_joint, force in zip(names, others, strict=True)]


def write_servo(
    name: str, joint: str, schedule: AbstractSchedule, actuators: ET.Element, inertia: float, timestep: float
) -> Control:
    """Adds an actuator that keeps a joint on a schedule, with the inertia's own share of the force in its control."""
    # As stiff as the steps of MuJoCo allow: what is prescribed here takes whatever force it needs there.
    rate = KEEPING / timestep
    stiffness, damping = inertia * rate**2, 2 * inertia * rate
    _add_affine(actuators, name, joint, stiffness, (0.0, -stiffness, -damping), None)

    def signal(t: Float[Array, ""]) -> Float[Array, ""]:
        theta, thetadot, thetaddot = schedule.derivatives(t)
        # The force is then I θ̈ of the schedule, plus a servo of the error; with θ alone as its control it would lag
        # behind.
        return theta + 2 / rate * thetadot + thetaddot / rate**2

    return Control(name, signal)


def _write_springs(springs: list[Spring], joint: ET.Element) -> None:
    stiffness = float(sum(spring.stiffness for spring in springs))
    if stiffness < 0:
        raise MJCFError(
            f"Joint `{joint.get('name')}` must have springs of a positive stiffness to be written as MJCF, but "
            f"together it is {stiffness:g}."
        )
    if stiffness > 0:
        joint.set("stiffness", repr(stiffness))
        rest = float(sum(spring.stiffness * spring.rest for spring in springs)) / stiffness
        only = float(springs[0].rest) if len(springs) == 1 else rest  # without rounding where there is nothing to add
        joint.set("springref", repr(only))


def _is_plain(force: AbstractJointForce) -> TypeGuard[JointFriction]:
    """Returns whether a force is dry friction that is the same at rest as in motion, MuJoCo's law."""
    if not isinstance(force, JointFriction) or force.smoothing is not None or force.stribeck is not None:
        return False
    return bool(force.largest == force.kinetic)


def _write_dampers(coefficients: list[float], joint: ET.Element) -> None:
    damping = float(sum(coefficients))
    if damping < 0:
        raise MJCFError(
            f"Joint `{joint.get('name')}` must have dampers that take energy away to be written as MJCF, but together "
            f"their coefficient is {damping:g}."
        )
    if damping > 0:
        joint.set("damping", repr(damping))


def _write_actuator(name: str, joint: str, force: AbstractJointForce, actuators: ET.Element) -> Control:
    if isinstance(force, Motor):
        _add_actuator(actuators, "motor", name, joint, force.limit)
        return Control(name, force.signal.prepare())
    if isinstance(force, SpeedLimitedMotor):
        stall = float(force.stall)
        # The line from torque to speed: stall · (command − θ̇ / free speed).
        _add_affine(actuators, name, joint, stall, (0.0, 0.0, -stall / float(force.free_speed)), None)
        return Control(name, force.command.prepare())
    if isinstance(force, PDServo):
        return _write_pd_servo(name, joint, force, actuators)
    if isinstance(force, JointFriction):
        raise MJCFError(
            f"Joint `{joint}` must have the same friction at rest and at every rate to be written as MJCF, whose "
            "`frictionloss` is one number, but it has another law; make its `static` friction that in motion."
        )
    raise MJCFError(
        f"Joint `{joint}` must be moved by motors, springs, dampers and servos to be written as MJCF, but it has a "
        f"{type(force).__name__}."
    )


def _write_pd_servo(name: str, joint: str, servo: PDServo, actuators: ET.Element) -> Control:
    stiffness, damping, target = float(servo.stiffness), float(servo.damping), servo.target.prepare()
    # Without stiffness no angle is a target, and the control is the rate.
    gain = damping if stiffness == 0 else stiffness
    _add_affine(actuators, name, joint, gain, (0.0, -stiffness, -damping), servo.limit)

    def signal(t: Float[Array, ""]) -> Float[Array, ""]:
        theta, thetadot, _ = target.derivatives(t)
        # MuJoCo damps θ̇, the servo here its difference from that of the target.
        return thetadot if stiffness == 0 else theta + damping / stiffness * thetadot

    return Control(name, signal)


def _add_affine(
    actuators: ET.Element, name: str, joint: str, gain: float, bias: tuple[float, float, float], limit: Array | None
) -> None:
    """Adds the actuator with the force gain × control + bias · (1, θ, θ̇)."""
    element = _add_actuator(actuators, "general", name, joint, limit)
    for key, value in {"biastype": "affine", "gainprm": repr(gain), "biasprm": " ".join(map(repr, bias))}.items():
        element.set(key, value)


def _add_actuator(actuators: ET.Element, tag: str, name: str, joint: str, limit: Array | None) -> ET.Element:
    bounds = None if limit is None else (-float(limit), float(limit))
    return add(actuators, tag, name=name, joint=joint, forcerange=bounds)


def read_springs(joint: ET.Element, angles: Angles) -> list[AbstractJointForce]:
    """Reads the spring, the damper and the dry friction among the attributes of a joint.

    **Raises:** :class:`MJCFError` where the joint has a rotor's inertia or a range.
    """
    refuse_values(joint, ("armature",), "a rotor geared to a joint has no counterpart here")
    refuse_values(joint, ("ref",), "angles are measured from the configuration in which the file has its bodies")
    if joint.get("range") is not None and joint.get("limited") != "false":
        raise MJCFError(
            f"Attribute `range` of {label(joint)} must be left out, because {LIMITS}; add `end-stops` to the scenario."
        )
    forces: list[AbstractJointForce] = []
    stiffness, damping = number(joint, "stiffness", 0.0), number(joint, "damping", 0.0)
    if stiffness:
        # The rest of a slide is a length.
        unit = angles.unit if joint.get("type", "hinge") == "hinge" else 1.0
        forces.append(Spring(stiffness, number(joint, "springref", 0.0) * unit))
    if damping:
        forces.append(Damper(damping))
    friction = number(joint, "frictionloss", 0.0)
    if friction:
        forces.append(JointFriction(friction))
    return forces


class Actuated(NamedTuple):
    """The forces of actuators by the names of their joints, and a sentence for each thing that was left out."""

    forces: dict[str, list[AbstractJointForce]]
    notes: list[str]


def read_actuators(actuators: Iterable[ET.Element], controls: Float[np.ndarray, " n"]) -> Actuated:
    """Reads the forces of actuators, with the controls that they keep.

    **Raises:** :class:`MJCFError` for an actuator whose force is none of those that joints have here.
    """
    forces: dict[str, list[AbstractJointForce]] = {}
    notes = []
    for element, control in zip(actuators, controls, strict=True):
        joint = element.get("joint")
        if joint is None:
            raise MJCFError(f"Element {label(element)} must act on a `joint`, but it acts on something else.")
        refuse_values(element, ("lengthrange",), "forces here do not depend on it")
        within = _range(element, "ctrl")
        # As MuJoCo does.
        control = float(control) if within is None else float(np.clip(control, *within))
        force, limits_control = _read_actuator(element, control, within)
        forces.setdefault(joint, []).append(force)
        if within is not None and not limits_control:
            notes.append(
                f"The `ctrlrange` of {label(element)} was not imported, because only a motor whose range is the same "
                f"in both directions has a limit that stands for it; its control, {control:g}, is within it."
            )
    return Actuated(forces, notes)


def _read_actuator(
    element: ET.Element, control: float, within: tuple[float, float] | None
) -> tuple[AbstractJointForce, bool]:
    """Reads the force of an actuator whose control is ``within`` a range, and whether its limit holds it there too."""
    limit, gear = _limit(element), float(numbers(element, "gear", (1.0,))[0])
    gain, stiffness, damping = (1.0, 0.0, 0.0) if element.tag == "motor" else _affine(element)
    if element.tag != "motor" and gear != 1:
        raise MJCFError(f'Attribute `gear` of {label(element)} must be 1 except for motors, but it is "{gear:g}".')
    if stiffness == 0 and damping == 0:
        limits_control = within is not None and within[0] == -within[1]
        # The force is proportional to the control, so the bounds of both are bounds of the force.
        if within is not None and limits_control:
            largest = abs(gain) * within[1]
            limit = largest if limit is None else min(limit, largest)
        # The range is that of the force before the gear.
        return Motor(gear * gain * control, None if limit is None else abs(gear) * limit), limits_control
    # A motor with a limited speed has no limit of its force but the stall.
    if stiffness == 0 and limit is None:
        return SpeedLimitedMotor(control, stall=gain, free_speed=gain / damping), False
    if stiffness == 0:
        return PDServo(ConstantRate(0.0, rate=gain * control / damping), 0.0, damping, limit), False
    return PDServo(ConstantRate(gain * control / stiffness), stiffness, damping, limit), False


def _range(element: ET.Element, what: str) -> tuple[float, float] | None:
    """Reads the range of an actuator's control (``ctrl``) or force, None where it has none or does not keep to it."""
    if element.get(f"{what}range") is None or element.get(f"{what}limited") == "false":
        return None
    low, high = numbers(element, f"{what}range", count=2)
    return float(low), float(high)


def _affine(element: ET.Element) -> tuple[float, float, float]:
    """Reads the gain, the stiffness and the damping of an actuator whose force is linear in its control, θ and θ̇."""
    if element.tag == "position":
        refuse_values(element, ("dampratio", "timeconst"), "it must have its damping as `kv`")
        stiffness = number(element, "kp", 1.0)
        return stiffness, stiffness, number(element, "kv", 0.0)
    if element.tag == "velocity":
        damping = number(element, "kv", 1.0)
        return damping, 0.0, damping
    linear = element.get("dyntype", "none") == "none" and element.get("gaintype", "fixed") == "fixed"
    biased = element.get("biastype", "none")
    bias = numbers(element, "biasprm", (0.0, 0.0, 0.0)) if biased == "affine" else np.zeros(3)
    if element.tag != "general" or not linear or biased not in ("none", "affine") or bias[0] != 0:
        raise MJCFError(
            f"Element {label(element)} must be a <motor>, <position> or <velocity>, or a <general> whose force is "
            "linear in its control, the angle and the rate of its joint, but it is not."
        )
    return float(numbers(element, "gainprm", (1.0,))[0]), -float(bias[1]), -float(bias[2])


def _limit(element: ET.Element) -> float | None:
    within = _range(element, "force")
    if within is None:
        return None
    low, high = within
    if low != -high:
        raise MJCFError(
            f"Attribute `forcerange` of {label(element)} must be the same in both directions, but it is "
            f'"{element.get("forcerange")}".'
        )
    return high


def control_values(controls: Iterable[Control], times: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T controls"]:
    """Computes the values of controls at some times."""
    columns = [np.asarray(jax.vmap(control.signal)(jnp.asarray(times))) for control in controls]
    return np.stack(columns, axis=-1) if columns else np.zeros((len(times), 0))
