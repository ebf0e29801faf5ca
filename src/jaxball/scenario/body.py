"""The body of a scenario file: the shell, gravity and the external force."""

from typing import Any

from ..physics.body import Ball, Disk, System
from .ground import GROUND
from .harmonics import FORCE
from .resistance import RESISTANCE
from .table import Key, join, read_table, write_member, write_table
from .traced import namespace, require, require_conditions
from .values import LENGTH, POSITIVE, Numbers

SHELL = {
    "mass": Key(Numbers(rule=POSITIVE)),
    "radius": Key(Numbers(rule=POSITIVE, dimension=LENGTH)),
    "gravity": Key(Numbers()),
    "offset": Key(Numbers((3,), dimension=LENGTH), (0.0, 0.0, 0.0)),
}
BALL = {**SHELL, "inertia": Key(Numbers((3,), POSITIVE))}
DISK = {**SHELL, "inertia": Key(Numbers(rule=POSITIVE))}
FLAT = "in the plane of a disk, E1 and E3, with second entry 0"
BODIES = {"ball": (Ball, BALL), "disk": (Disk, DISK)}


def read_shell(values: Any, path: str, kind: str) -> dict[str, Any]:
    """The arguments of a ball or a disk for its shell. A shell that no body can have raises."""
    make, keys = BODIES[kind]
    shell = read_table(values, path, keys)
    system = make(**shell)
    require_conditions(system, under=f"{path}.")
    return shell


def read_force(values: Any, path: str, kind: str) -> Any:
    """The external force; that on a disk must lie in the disk's plane."""
    force = FORCE.read(values, path)
    for name in ("constant", "amplitude", "powers"):
        array = getattr(force.series, name)
        if array is None:
            continue
        flat = kind != "disk" or (namespace(array).asarray(array)[..., 1] == 0).all()
        require(flat, join(path, name), FLAT, lambda name=name: repr(values[name]))
    return force


def write_body(system: System) -> dict[str, Any]:
    """The table [body], and [force], [ground] and [resistance] where there are such."""
    kind = kind_of(system)
    keys = BODIES[kind][1]
    tables = {"body": write_table({name: getattr(system, name) for name in keys}, "body", keys)}
    surroundings = {"force": FORCE, "ground": GROUND, "resistance": RESISTANCE}
    for name, module in surroundings.items():
        if getattr(system, name) is not None:
            table = write_member(getattr(system, name), name, {name: module})[1]
            first, key = next(iter(module.keys.items()))
            tables[name] = table or {first: key.kind.write(key.default, name)}  # lest it be taken for none at all
    return tables


def kind_of(system: System) -> str:
    """The name of the kind of body in a file, ``ball`` or ``disk``."""
    return "ball" if isinstance(system, Ball) else "disk"
