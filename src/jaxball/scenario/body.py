"""The body of a scenario file: the shell, gravity and external loads."""

from typing import Any

from ..physics.body import Ball, Disk, System
from ..physics.force import AbstractWrench, FunctionWrench, HarmonicForce, require_wrench
from .functions import FUNCTION, trying
from .ground import GROUND
from .harmonics import FORCE
from .own import Open, names_own, read_own, trying_class
from .resistance import RESISTANCES
from .table import Family, Key, Module, join, read_one_of, read_table, write_member, write_table
from .traced import namespace, require, require_conditions
from .values import LENGTH, POSITIVE, TIME, Numbers

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
FORCES = Open(
    AbstractWrench,
    {
        "": FORCE,
        "function": Module(FunctionWrench, {**FUNCTION, "kink_times": Key(Numbers((None,), dimension=TIME), ())}),
    },
)


def read_shell(values: Any, path: str, kind: str) -> dict[str, Any]:
    """The arguments of a ball or a disk for its shell. An impossible shell raises."""
    make, keys = BODIES[kind]
    shell = read_table(values, path, keys)
    system = make(**shell)
    require_conditions(system, under=f"{path}.")
    return shell


def read_force(values: Any, path: str, kind: str) -> AbstractWrench:
    """The external force: a user's class or function, or a series, which on a disk must lie in the disk's plane."""
    if names_own(values):
        return read_own(values, path, FORCES)
    choices = {name: force.keys for name, force in FORCES.items() if name}
    if read_one_of(values, path, choices, FORCE.keys)[0]:
        with trying(join(path, "function")):
            return FORCES["function"].read(values, path)
    force = FORCE.read(values, path)
    for name in ("constant", "amplitude", "powers"):
        array = getattr(force.series, name)
        if array is None:
            continue
        flat = kind != "disk" or (namespace(array).asarray(array)[..., 1] == 0).all()
        require(flat, join(path, name), FLAT, lambda name=name: repr(values[name]))
    return force


def check_force(force: AbstractWrench | None, path: str, coordinates: int) -> None:
    """Raises unless a user's function or class returns a force on a body with so many ``coordinates``."""
    if isinstance(force, FunctionWrench):
        with trying(join(path, "function")):
            require_wrench("function", force, coordinates)
    elif force is not None and not isinstance(force, HarmonicForce):
        with trying_class(path, type(force).__name__):
            require_wrench("wrench", force, coordinates)


def write_body(system: System) -> dict[str, Any]:
    """The table [body], and [force], [ground] and [resistance] where these exist."""
    kind = kind_of(system)
    keys = BODIES[kind][1]
    tables = {"body": write_table({name: getattr(system, name) for name in keys}, "body", keys)}
    surroundings: dict[str, Family] = {"force": FORCES, "ground": {"": GROUND}, "resistance": RESISTANCES}
    for name, family in surroundings.items():
        if getattr(system, name) is not None:
            kind, table = write_member(getattr(system, name), name, family)
            if kind not in family:
                tables[name] = {"kind": kind, **table}
                continue
            first, key = next(iter(family[kind].keys.items()))
            tables[name] = table or {
                first: key.kind.write(key.default, name)
            }  # because an empty table would be taken for none
    return tables


def kind_of(system: System) -> str:
    """The name of the kind of body in a file, ``ball`` or ``disk``."""
    return "ball" if isinstance(system, Ball) else "disk"
