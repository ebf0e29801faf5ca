"""Reads the forces of joints: the springs, dampers and dry friction among their attributes, and those of actuators."""

import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...interface.wording import all_of
from ...physics.mechanisms import (
    AbstractJointForce,
    Damper,
    JointFriction,
    Motor,
    PDServo,
    SpeedLimitedMotor,
    Spring,
)
from .drives import Recording
from .elements import LIMITS, MJCFError, Settings, label, number, numbers
from .schema import ACTUATORS

GEARS = 6  # of which a hinge and a slide use the first


class Law(NamedTuple):
    """The force of an actuator: gain × control − stiffness × length − damping × rate, before its gear."""

    gain: float
    stiffness: float
    damping: float

    @property
    def is_servo(self) -> bool:
        """Whether the control is a length; for such a law MuJoCo reads a negative damping as a ratio."""
        return self.gain == self.stiffness != 0


def read_springs(joint: ET.Element, settings: Settings) -> list[AbstractJointForce]:
    """Reads the spring, the damper and the dry friction among the attributes of a joint.

    **Raises:** :class:`MJCFError` where the joint has a range, or a spring or damper that is not linear.
    """
    if settings.limits(joint, "") is not None and "limit" not in settings.disabled:
        raise MJCFError(
            f"Attribute `range` of {label(joint)} must be left out, because {LIMITS}; add `end-stops` to the scenario."
        )
    forces: list[AbstractJointForce] = []
    stiffness, damping = linear(joint, "stiffness"), linear(joint, "damping")
    if stiffness and "spring" not in settings.disabled:
        # The rest of a slide is a length.
        unit = settings.angles.unit if joint.get("type", "hinge") == "hinge" else 1.0
        forces.append(Spring(stiffness, number(joint, "springref", 0.0) * unit))
    if damping and "damper" not in settings.disabled:
        forces.append(Damper(damping))
    friction = number(joint, "frictionloss", 0.0)
    if friction and "frictionloss" not in settings.disabled:
        forces.append(JointFriction(friction))
    return forces


def linear(element: ET.Element, name: str) -> float:
    """Reads a stiffness or a damping, which MuJoCo lets have terms of higher powers.

    **Raises:** :class:`MJCFError` where there are such.
    """
    if element.get(name) is None:
        return 0.0
    coefficients = numbers(element, name)
    if len(coefficients) == 0 or np.any(coefficients[1:] != 0):
        raise MJCFError(
            f"Attribute `{name}` of {label(element)} must be a number, because springs and dampers are linear here, "
            f'but it is "{element.get(name)}".'
        )
    return float(coefficients[0])


Forces = dict[str, list[AbstractJointForce]]


def read_actuators(
    actuators: list[ET.Element], controls: list[Recording], settings: Settings
) -> tuple[Forces, list[str]]:
    """Reads the forces of actuators, with the controls that they keep, by the names of their joints, and a sentence
    for each thing that was left out.

    **Raises:** :class:`MJCFError` for an actuator whose force is none of those that joints have here.
    """
    forces: Forces = {}
    notes, still = [], []
    for element, control in zip(actuators, controls, strict=True):
        within = None if "clampctrl" in settings.disabled else settings.limits(element, "ctrl")
        # As MuJoCo does.
        control = control if within is None else control.clip(*within)
        exerted, limits_control = _read_actuator(element, control, within, settings)
        disabled = "actuation" in settings.disabled or number(element, "group", 0.0) in settings.idle_groups
        # The damper of an actuator belongs to its joint, also where the actuator is disabled.
        exerted = [_damper(element, settings), None if disabled else exerted]
        forces.setdefault(joint_of(element), []).extend(force for force in exerted if force is not None)
        still += [label(element)] if disabled else []
        if within is not None and not limits_control:
            notes.append(
                f"The `ctrlrange` of {label(element)} was not imported, because only a motor whose range is the same "
                f"in both directions has a limit that stands for it; its control, {control.values[0]:g}, is within it."
            )
    if still:
        notes.append(f"No force of {all_of(still)} was imported, because the <option> of the file disables it.")
    return forces, notes


def joint_of(actuator: ET.Element) -> str:
    """Returns the name of the joint that an actuator acts on.

    **Raises:** :class:`MJCFError` where it acts on none.
    """
    # Both are the same for joints of one axis.
    joint = actuator.get("joint", actuator.get("jointinparent"))
    if joint is None:
        raise MJCFError(f"Element {label(actuator)} must act on a `joint`, but it acts on something else.")
    return joint


def gear_of(actuator: ET.Element) -> float:
    """Reads the gear of an actuator of a joint with one axis: the first of up to six numbers."""
    gears = np.ones(1) if actuator.get("gear") is None else numbers(actuator, "gear")
    if not 1 <= len(gears) <= GEARS:
        raise MJCFError(
            f'Attribute `gear` of {label(actuator)} must be up to {GEARS} numbers, but it is "{actuator.get("gear")}".'
        )
    return float(gears[0])


def law_of(actuator: ET.Element) -> Law:
    """Reads the law of an actuator whose force is linear in its control, its length and its rate.

    **Raises:** :class:`MJCFError` for another law.
    """
    if actuator.tag == "motor":
        return Law(1.0, 0.0, 0.0)
    if actuator.tag == "position":
        stiffness = number(actuator, "kp", 1.0)
        return Law(stiffness, stiffness, number(actuator, "kv", 0.0))
    if actuator.tag == "velocity":
        damping = number(actuator, "kv", 1.0)
        return Law(damping, 0.0, damping)
    stateless = actuator.get("dyntype", "none") == "none" and actuator.get("gaintype", "fixed") == "fixed"
    biased = actuator.get("biastype", "none")
    bias = _first(actuator, "biasprm", np.zeros(3)) if biased == "affine" else np.zeros(3)
    if actuator.tag not in ACTUATORS or not stateless or biased not in ("none", "affine") or bias[0] != 0:
        raise MJCFError(
            f"Element {label(actuator)} must be a <motor>, <position> or <velocity>, or a <general> whose force is "
            "linear in its control, the angle and the rate of its joint, but it is not."
        )
    return Law(float(_first(actuator, "gainprm", np.ones(1))[0]), -float(bias[1]), -float(bias[2]))


def _first(element: ET.Element, name: str, default: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Reads the first numbers of an attribute that may have more than the ``default``, or fewer."""
    values = numbers(element, name) if element.get(name) is not None else default
    return np.append(values, default[len(values) :])[: len(default)]


def _damper(element: ET.Element, settings: Settings) -> Damper | None:
    damping = gear_of(element) ** 2 * linear(element, "damping")
    return Damper(damping) if damping and "damper" not in settings.disabled else None


def _read_actuator(
    element: ET.Element, control: Recording, within: tuple[float, float] | None, settings: Settings
) -> tuple[AbstractJointForce, bool]:
    """Reads the force of an actuator whose control is ``within`` a range, and whether its limit holds it there too."""
    gear, law, limit = gear_of(element), law_of(element), _limit(element, settings)
    # The gear multiplies the length of which the force is, and that force again.
    gain, stiffness, damping = gear * law.gain, gear**2 * law.stiffness, gear**2 * law.damping
    limit = None if limit is None else abs(gear) * limit
    if stiffness == 0 and damping == 0:
        limits_control = within is not None and within[0] == -within[1]
        # The force is proportional to the control, so the bounds of both are bounds of the force.
        if within is not None and limits_control:
            largest = abs(gain) * within[1]
            limit = largest if limit is None else min(limit, largest)
        return Motor(control.scale(gain).signal(), limit), limits_control
    # A motor with a limited speed has no limit of its force but the stall.
    if stiffness == 0 and limit is None and gain != 0 and damping > 0:
        stall = abs(gain)
        command = control.scale(float(np.sign(gain))).signal()
        return SpeedLimitedMotor(command, stall=stall, free_speed=stall / damping), False
    if stiffness == 0:
        return PDServo(control.scale(gain / damping).integral(), 0.0, damping, limit), False
    # A servo here damps θ̇ less the rate of its target, and MuJoCo's damps θ̇.
    target = control.scale(gain / stiffness).target(damping / stiffness)
    return PDServo(target, stiffness, damping, limit), False


def _limit(element: ET.Element, settings: Settings) -> float | None:
    within = settings.limits(element, "force")
    if within is None:
        return None
    low, high = within
    if low != -high:
        raise MJCFError(
            f"Attribute `forcerange` of {label(element)} must be the same in both directions, but it is "
            f'"{element.get("forcerange")}".'
        )
    return high
