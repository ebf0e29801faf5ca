"""Writes and reads sensors: those of MuJoCo that read the same quantity, at sites on the same parts."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...physics.prescribed.frames import MatrixFrame
from ...physics.sensors import AbstractSensor, Accelerometer, Encoder, Gyroscope, Position, Tachometer
from .elements import Frame, MJCFError, add, label, refuse_values

Shift = Float[np.ndarray, "3"]
AT_SITES = {Accelerometer: "accelerometer", Gyroscope: "gyro", Position: "framepos"}
OF_JOINTS = {Encoder: "jointpos", Tachometer: "jointvel"}


class Site(NamedTuple):
    """A site: the joint whose link it is on, None for the shell, and its frame in the ball with every θ at 0."""

    on: str | None
    frame: Frame


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
            attributes = {"objtype": "site", "objname": name} if isinstance(sensor, Position) else {"site": name}
            add(elements, AT_SITES[type(sensor)], name=name, **attributes)


def _site(name: str, sensor: Accelerometer | Gyroscope | Position, shift: Shift) -> ET.Element:
    # A gyroscope reads the same everywhere on a part, and has no place here.
    position = shift if isinstance(sensor, Gyroscope) else np.asarray(sensor.at) + shift
    B = np.eye(3) if isinstance(sensor, Position) else np.asarray(sensor.frame.matrix())
    turn = None if np.array_equal(B, np.eye(3)) else (*B[:, 0], *B[:, 1])
    return add(ET.Element("body"), "site", name=name, pos=position, xyaxes=turn)


def read_sensors(root: ET.Element, sites: Mapping[str, Site], joints: Mapping[str, str]) -> dict[str, AbstractSensor]:
    """Reads the sensors of a file by their names, from its sites, and from its joints, whose paths here are given by
    name.

    The noise that a file states is left out, because MuJoCo adds none either.

    **Raises:** :class:`MJCFError` for a sensor of another kind, and for one that is not on the robot.
    """
    sensors: dict[str, AbstractSensor] = {}
    for index, element in enumerate(child for group in root.findall("sensor") for child in group):
        refuse_values(element, ("cutoff",), "readings are not cut off here")
        # Scenarios have names that are identifiers.
        name = re.sub(r"\W", "_", element.get("name", ""), flags=re.ASCII)
        name = name if name[:1].isalpha() else f"sensor_{name or index}"
        sensors[name] = _read_sensor(element, sites, joints)
    return sensors


def _read_sensor(element: ET.Element, sites: Mapping[str, Site], joints: Mapping[str, str]) -> AbstractSensor:
    kind = {tag: kind for kind, tag in {**OF_JOINTS, **AT_SITES}.items()}.get(element.tag)
    if kind is None:
        tags = ", ".join(f"<{tag}>" for tag in (*AT_SITES.values(), *OF_JOINTS.values()))
        raise MJCFError(f"Element {label(element)} must be one of {tags}, because others have no counterpart here.")
    if kind in OF_JOINTS:
        return kind(on=_find_part(element, "joint", joints))
    if element.tag == "framepos" and (element.get("objtype") != "site" or element.get("reftype") is not None):
        raise MJCFError(
            f"Element {label(element)} must be the place of a site in space, with `objtype` site and no `reftype`, "
            "but it is another."
        )
    site = _find_part(element, "objname" if kind is Position else "site", sites)
    # A gyroscope reads the same everywhere on a part, and the place of a site has no axes.
    place: dict[str, Any] = {} if kind is Gyroscope else {"at": site.frame.shift}
    axes: dict[str, Any] = {} if kind is Position else {"frame": MatrixFrame(site.frame.turn)}
    return kind(on=site.on, **place, **axes)


def _find_part(element: ET.Element, attribute: str, parts: Mapping[str, Any]) -> Any:
    name = element.get(attribute, "")
    if name not in parts:
        raise MJCFError(
            f'Attribute `{attribute}` of {label(element)} must name a part of the robot, but it is "{name}".'
        )
    return parts[name]
