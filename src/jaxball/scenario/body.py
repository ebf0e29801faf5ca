"""The body of a scenario file: the shell, gravity and the external force."""

from typing import Any

import numpy as np

from ..physics.body import Ball, Disk, System
from .harmonics import FORCE
from .table import Key, join, read_table, write_member, write_table
from .values import POSITIVE, Numbers, key_error

SHELL = {
    "mass": Key(Numbers(rule=POSITIVE)),
    "radius": Key(Numbers(rule=POSITIVE)),
    "gravity": Key(Numbers()),
    "offset": Key(Numbers((3,)), (0.0, 0.0, 0.0)),
}
BALL = {**SHELL, "inertia": Key(Numbers((3,), POSITIVE))}
DISK = {**SHELL, "inertia": Key(Numbers(rule=POSITIVE))}
FLAT = "in the plane of a disk, E1 and E3, with second entry 0"
BODIES = {"ball": (Ball, BALL), "disk": (Disk, DISK)}


def read_shell(values: Any, path: str, kind: str) -> dict[str, Any]:
    """The arguments of a ball or a disk for its shell. A shell that no body can have raises."""
    make, keys = BODIES[kind]
    found = read_table(values, path, keys)
    for condition in make(**found).conditions():
        if not bool(condition.holds):
            value = np.asarray(condition.value).tolist()
            raise key_error(join(path, condition.name), condition.must, repr(value))
    return found


def read_force(values: Any, path: str, kind: str) -> Any:
    """The external force; that on a disk must lie in the disk's plane."""
    force = FORCE.read(values, path)
    for name in ("constant", "amplitude"):
        sideways = np.asarray(getattr(force.series, name))[..., 1]
        if kind == "disk" and np.any(sideways != 0):
            raise key_error(join(path, name), FLAT, repr(values[name]))
    return force


def write_body(system: System) -> dict[str, Any]:
    """The tables [body] and [force], the latter where there is a force."""
    kind = kind_of(system)
    found = {name: getattr(system, name) for name in BODIES[kind][1]}
    tables = {"body": write_table(found, "body", BODIES[kind][1])}
    if system.force is not None:
        tables["force"] = write_member(system.force, "force", {"force": FORCE})[1]
    return tables


def kind_of(system: System) -> str:
    """The name of the kind of body in a file, ``ball`` or ``disk``."""
    return "ball" if isinstance(system, Ball) else "disk"
