"""The forces on joints that a scenario file can hold, and their keys."""

from typing import Any

from ..physics.mechanisms import (
    AbstractJointForce,
    Damper,
    EndStops,
    JointForces,
    Motor,
    PDServo,
    SpeedLimitedMotor,
    Spring,
)
from .own import Open
from .schedules import SCHEDULE
from .signals import SIGNAL
from .table import Family, Key, Module, keys_of, read_family, read_list, write_family
from .traced import require_conditions
from .values import ANGLE, RATE, TIME, Flag, Nested, Numbers, key_error, shown

_NUMBER, _ZERO, _LIMIT = Key(Numbers()), Key(Numbers(), 0.0), Key(Numbers(), None)
_END = Key(Numbers(dimension=ANGLE))

_FAMILIES: Family = {
    "motor": Module(Motor, {"signal": Key(SIGNAL), "limit": _LIMIT}),
    "spring": Module(Spring, {"stiffness": _NUMBER, "rest": Key(Numbers(dimension=ANGLE), 0.0)}),
    "damper": Module(Damper, {"coefficient": _NUMBER, "negative": Key(Flag(), False)}),
    "speed-limited-motor": Module(
        SpeedLimitedMotor, {"command": Key(SIGNAL), "stall": _NUMBER, "free_speed": Key(Numbers(dimension=RATE))}
    ),
    "pd-servo": Module(PDServo, {"target": SCHEDULE, "stiffness": _NUMBER, "damping": _ZERO, "limit": _LIMIT}),
    "end-stops": Module(
        EndStops,
        {"lower": _END, "upper": _END, "stiffness": _NUMBER, "damping": Key(Numbers(dimension=TIME), 0.0)},
    ),
}
FORCES = Open(AbstractJointForce, _FAMILIES)
_WORDS = "a table, or a list of tables whose forces add up"


def read_forces(values: Any, path: str) -> AbstractJointForce:
    """A force on a joint, or the sum of those in a list."""
    if isinstance(values, list):
        return JointForces(tuple(read_list(values, path, _read_force, empty=True)))
    if not isinstance(values, dict):
        raise key_error(path, _WORDS, shown(values))
    return _read_force(values, path)


def _read_force(values: Any, path: str) -> AbstractJointForce:
    force = read_family(values, path, FORCES)
    require_conditions(force, "", path)
    return force


def write_forces(force: AbstractJointForce, path: str) -> Any:
    """The table of a force on a joint, or the list of those of a sum."""
    if isinstance(force, JointForces):
        return [write_family(term, f"{path}[{index}]", FORCES) for index, term in enumerate(force.terms)]
    return write_family(force, path, FORCES)


FORCE = Key(Nested(read_forces, write_forces, _WORDS, keys_of(FORCES)), None)
