"""Sensors: those of MuJoCo that read the same quantity, at sites on the same parts."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ..sensors import AbstractSensor, Accelerometer, Encoder, Gyroscope, Position, Tachometer
from .elements import MJCFError, add

Shift = Float[np.ndarray, "3"]
AT_SITES = {Accelerometer: "accelerometer", Gyroscope: "gyro", Position: "framepos"}
OF_JOINTS = {Encoder: "jointpos", Tachometer: "jointvel"}


def write_sensors(
    sensors: Mapping[str, AbstractSensor], shell: ET.Element, elements: ET.Element, shifts: Mapping[str, Shift]
) -> None:
    """Adds the sensors to ``elements``, and the sites that they are at to the bodies in the shell.

    ``shifts`` has, for the bodies that turn with their link as here, where their points are with every θ at 0.

    **Raises:** :class:`MJCFError` for a sensor that MuJoCo does not have, or one on a part that turns otherwise there.
    """
    bodies = {body.get("name"): body for body in shell.iter("body")}
    joints = {joint.get("name") for joint in shell.iter("joint")}
    for name, sensor in sensors.items():
        if isinstance(sensor, Encoder | Tachometer) and sensor.on in joints:
            add(elements, OF_JOINTS[type(sensor)], name=name, joint=sensor.on)
        elif not isinstance(sensor, Accelerometer | Gyroscope | Position):
            on = f" on `{sensor.on}`" if isinstance(sensor, Encoder | Tachometer) else ""
            raise MJCFError(
                f"Sensor `{name}` must be one that MuJoCo has, on a joint or a part of the robot, but it is a "
                f"{type(sensor).__name__}{on}."
            )
        elif sensor.on is not None and sensor.on not in shifts:
            raise MJCFError(
                f"Sensor `{name}` must be on the shell, a hinge, a slider or a mass of a mechanism to be written as "
                f"MJCF, but it is on `{sensor.on}`, which turns otherwise there."
            )
        else:
            site = _site(name, sensor, np.zeros(3) if sensor.on is None else shifts[sensor.on])
            body = shell if sensor.on is None else bodies[sensor.on]
            body.insert(1, site)  # after its inertia
            at = {"objtype": "site", "objname": name} if isinstance(sensor, Position) else {"site": name}
            add(elements, AT_SITES[type(sensor)], name=name, **at)


def _site(name: str, sensor: Accelerometer | Gyroscope | Position, shift: Shift) -> ET.Element:
    at = shift if isinstance(sensor, Gyroscope) else np.asarray(sensor.at) + shift
    B = np.eye(3) if isinstance(sensor, Position) else np.asarray(sensor.frame.matrix())
    turn = None if np.array_equal(B, np.eye(3)) else (*B[:, 0], *B[:, 1])
    return add(ET.Element("body"), "site", name=name, pos=at, xyaxes=turn)
