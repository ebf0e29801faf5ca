"""The sensors of a scenario file, each a table with its own name."""

import re
from collections.abc import Mapping
from typing import Any

from ..physics.body import AbstractBody
from ..sensors import AbstractSensor, Accelerometer, Encoder, Gyroscope, Tachometer
from .frames import FRAME
from .own import Open
from .table import Family, Key, Module, join, read_family, write_family
from .values import LENGTH, Numbers, ScenarioError, Text, key_error, shown

_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_ON = Key(Text("the name of a part of the body, such as masses[0] or mechanisms[0].joints[0]"))
_MOUNT = {"on": Key(_ON.kind, None), "frame": FRAME}
_FAMILIES: Family = {
    "accelerometer": Module(Accelerometer, {"at": Key(Numbers((3,), dimension=LENGTH), (0.0, 0.0, 0.0)), **_MOUNT}),
    "gyroscope": Module(Gyroscope, _MOUNT),
    "encoder": Module(Encoder, {"on": _ON}),
    "tachometer": Module(Tachometer, {"on": _ON}),
}
SENSORS = Open(AbstractSensor, _FAMILIES)


def read_sensors(values: Any, path: str) -> dict[str, AbstractSensor]:
    """The sensors by their names, which files and figures use."""
    if not isinstance(values, dict):
        raise key_error(path, f"a table of tables, each under the heading [{path}.name]", shown(values))
    for name in values:
        if not _NAME.fullmatch(name):
            raise ScenarioError(
                f"Key `{path}` must have names of letters, digits and underscores that begin with a letter, but it has "
                f"{shown(name)}."
            )
    return {name: read_family(table, join(path, name), SENSORS) for name, table in values.items()}


def check_sensors(sensors: Mapping[str, AbstractSensor], path: str, system: AbstractBody) -> None:
    """Raises where the body lacks the part that a sensor is on."""
    for name, sensor in sensors.items():
        try:
            sensor.require_on(system, join(path, name))
        except ValueError as error:
            raise ScenarioError(str(error).replace("Argument ", "Key ", 1)) from None


def write_sensors(sensors: Mapping[str, AbstractSensor], path: str) -> dict[str, Any]:
    """The tables of the sensors by name."""
    return {name: write_family(sensor, join(path, name), SENSORS) for name, sensor in sensors.items()}
