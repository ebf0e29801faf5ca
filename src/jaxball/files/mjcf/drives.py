"""Writes the drives of joints: springs and dampers as attributes of MuJoCo's joints, others as actuators.

Controls that vary over time, and save times, stand beside the robot in a file of jaxball's own: MJCF has no place for
them but ``<custom>``, whose numbers MuJoCo keeps and does not heed.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, TypeGuard

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from ...physics.mechanisms import (
    AbstractJointForce,
    Accelerated,
    Damper,
    Drive,
    EndStops,
    HardStops,
    JointForces,
    JointFriction,
    Motor,
    PDServo,
    SpeedLimitedMotor,
    Spring,
)
from ...physics.prescribed.recorded import RecordedSignal
from ...physics.prescribed.schedules import AbstractSchedule, ConstantRate, Waypoints
from ...physics.prescribed.signals import AbstractSignal, ConstantSignal
from .elements import MJCFError, add, numbers

Signal = Callable[[Float[Array, ""]], Float[Array, ""]]
KEEPING = 0.2  # of a servo that stands for a prescribed motion: its natural frequency times the time step


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
    if any(isinstance(force, HardStops) for force in forces):
        raise MJCFError(
            f"Joint `{name}` must have no HardStops to be written as MJCF, whose limits are springs with dampers; give "
            "it EndStops."
        )
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


def control_values(controls: Iterable[Control], times: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T controls"]:
    """Computes the values of controls at some times."""
    columns = [np.asarray(jax.vmap(control.signal)(jnp.asarray(times))) for control in controls]
    return np.stack(columns, axis=-1) if columns else np.zeros((len(times), 0))


TIMES = "jaxball.times"
CONTROL = "jaxball.control "  # and the name of the actuator
MORE = "jaxball.more {} "  # with a number, and the name of the element whose numbers go on here
MOST_NUMBERS = 500  # in one element: with more MuJoCo does not open a file, or ends the process


class Recording(NamedTuple):
    """The control of an actuator: its values at some times, or a single one that it keeps."""

    times: Float[np.ndarray, " T"]
    values: Float[np.ndarray, " T"]

    @classmethod
    def constant(cls, value: float) -> "Recording":
        return cls(np.zeros(1), np.full(1, value))

    @property
    def varies(self) -> bool:
        return len(self.values) > 1

    def scale(self, by: float) -> "Recording":
        return Recording(self.times, by * self.values)

    def clip(self, low: float, high: float) -> "Recording":
        return Recording(self.times, np.clip(self.values, low, high))

    def signal(self) -> AbstractSignal:
        """Returns the control as a signal: linear between the times, because it may jump, and held outside of them."""
        if not self.varies:
            return ConstantSignal(float(self.values[0]))
        return RecordedSignal(self.times, self.values, outside="hold")

    def target(self, lag: float) -> ConstantRate | Waypoints:
        """Computes the schedule θ of which the control is θ + ``lag`` θ̇, as that of a servo is."""
        if not self.varies:
            return ConstantRate(float(self.values[0]))
        if lag <= 0:
            return Waypoints(self.times, self.values, CubicSpline(self.times, self.values)(self.times[[0, -1]], 1))
        theta = _follow(CubicSpline(self.times, self.values), lag)
        rates = (self.values - theta) / lag
        return Waypoints(self.times, theta, rates[[0, -1]])

    def integral(self) -> ConstantRate | Waypoints:
        """Computes the schedule whose rate is the control, 0 at the start."""
        if not self.varies:
            return ConstantRate(0.0, rate=float(self.values[0]))
        theta = CubicSpline(self.times, self.values).antiderivative()(self.times)
        return Waypoints(self.times, theta, self.values[[0, -1]])


def _follow(spline: CubicSpline, lag: float) -> Float[np.ndarray, " T"]:
    """Computes θ with θ + ``lag`` θ̇ = u at the knots of the spline u, without what dies out from the start on.

    On each piece θ is a cubic polynomial, u − lag u̇ + lag² ü − lag³ u⃛, and an exponential that makes it continuous
    where u⃛ jumps.
    """
    slow = sum((-lag) ** order * spline(spline.x, order) for order in range(4))
    # At its end a piece has the third derivative of the one after it in `slow`, but for the last.
    third = spline.c[0] * 6
    jumps = np.append(np.diff(third), 0.0) * lag**3
    theta, rest = np.array(slow), 0.0
    for index, (step, jump) in enumerate(zip(np.diff(spline.x), jumps, strict=True)):
        rest = rest * np.exp(-step / lag) + jump
        theta[index + 1] += rest
    return theta


def write_recordings(root: ET.Element, times: Float[np.ndarray, " T"], controls: Sequence[Control]) -> None:
    """Adds the save times to a file, and the controls that vary over them."""
    custom = ET.SubElement(root, "custom")
    _add_numbers(custom, TIMES, times)
    for control, values in zip(controls, control_values(controls, times).T, strict=True):
        if np.any(values != values[0]):
            _add_numbers(custom, f"{CONTROL}{control.actuator}", values)


def _add_numbers(custom: ET.Element, name: str, values: Float[np.ndarray, " T"]) -> None:
    """Adds numbers, in as many elements as they need, whose names differ, as MuJoCo requires."""
    for start in range(0, len(values), MOST_NUMBERS):
        more = MORE.format(start // MOST_NUMBERS) if start else ""
        add(custom, "numeric", name=f"{more}{name}", data=values[start : start + MOST_NUMBERS])


def _join_numbers(root: ET.Element) -> dict[str, ET.Element]:
    """Returns the elements with numbers by name, those that go on in others joined with these."""
    parts: dict[str, list[str]] = {}
    for element in root.findall("custom/numeric"):
        name = re.sub(f"^{MORE.format(r'[0-9]+')}", "", element.get("name", ""))
        parts.setdefault(name, []).append(element.get("data", ""))
    return {name: ET.Element("numeric", name=name, data=" ".join(data)) for name, data in parts.items()}


def read_recordings(root: ET.Element) -> Mapping[str, Recording]:
    """Reads the controls that a file has of all save times, by the names of the actuators.

    The times themselves have the name :data:`TIMES`, if the file has any.

    **Raises:** :class:`MJCFError` for times that do not increase, and for controls of other times.
    """
    numeric = _join_numbers(root)
    if TIMES not in numeric:
        return {}
    times = numbers(numeric[TIMES], "data")
    if len(times) < 1 or np.any(np.diff(times) <= 0):
        raise MJCFError(
            f'The numbers of <numeric name="{TIMES}"> must increase, because they are the save times, but they do not; '
            "leave the element out, and give `times`."
        )
    recordings = {TIMES: Recording(times, times)}
    for name, element in numeric.items():
        if name.startswith(CONTROL):
            values = numbers(element, "data", count=len(times))
            recordings[name.removeprefix(CONTROL)] = Recording(times, values)
    return recordings
