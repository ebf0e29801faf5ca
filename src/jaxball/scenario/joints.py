"""The joints of mechanisms in a scenario file, and what drives them."""

from collections.abc import Callable
from typing import Any, NamedTuple

from ..physics.mechanisms import AbstractJoint, AbstractJointForce, Accelerated, Carriage, Drive, Hinge, Slider
from ..physics.schedules import AbstractSchedule
from .joint_forces import FORCE
from .rails import RAILS
from .schedules import SCHEDULE
from .table import Family, Key, Module, join, member_of, read_family, write_member
from .values import LENGTH, NOT_ALL_ZERO, Flag, Integer, Numbers, ScenarioError

MOST_JOINTS = 10_000

_ON = {"on": Key(Integer(-1, MOST_JOINTS), None)}
_AXIS = Key(Numbers((3,), NOT_ALL_ZERO))
_GEOMETRY: Family = {
    "hinge": Module(Hinge, {"axis": _AXIS, "point": Key(Numbers((3,), dimension=LENGTH), (0.0, 0.0, 0.0)), **_ON}),
    "slider": Module(Slider, {"axis": _AXIS, **_ON}),
    "carriage": Module(Carriage, {"rail": Key(member_of(RAILS)), **_ON}),
}
_DRIVES = {
    "schedule": Key(SCHEDULE.kind, None),
    "force": FORCE,
    "accelerated": Key(Flag(), False),
}


class ReadJoint(NamedTuple):
    """A joint, and the schedule that a law accelerating it follows, if there is one."""

    joint: AbstractJoint
    target: AbstractSchedule | None


def _maker(module: Module) -> Callable[..., ReadJoint]:
    def make(accelerated: bool, schedule=None, force=None, **geometry: Any) -> ReadJoint:
        drive = Accelerated() if accelerated else schedule if force is None else force
        return ReadJoint(module.type(**geometry, drive=drive), schedule if accelerated else None)

    return make


def _check_drive(table: dict[str, Any], path: str) -> None:
    if table["force"] is None:
        return
    for name in ("schedule", "accelerated"):
        if table[name]:
            raise ScenarioError(
                f"Key `{join(path, name)}` must not be combined with `force`, because a joint moves either by a "
                "prescribed motion or under forces; leave one of them out."
            )


JOINTS: Family = {
    kind: Module(module.type, {**module.keys, **_DRIVES}, build=_maker(module), check=_check_drive)
    for kind, module in _GEOMETRY.items()
}


def read_joint(values: Any, path: str) -> ReadJoint:
    """A joint of any kind."""
    return read_family(values, path, JOINTS)


def write_joint(joint: AbstractJoint, target: AbstractSchedule | None, path: str) -> dict[str, Any]:
    """The table of a joint, with the ``target`` that a law gives it."""
    kind, table = write_member(joint, path, _GEOMETRY)
    return {"kind": kind, **table, **_write_drive(joint.drive, target, path)}


def _write_drive(drive: Drive, target: AbstractSchedule | None, path: str) -> dict[str, Any]:
    if isinstance(drive, AbstractJointForce):
        return {"force": FORCE.kind.write(drive, join(path, "force"))}
    schedule = target if isinstance(drive, Accelerated) else drive
    accelerated = {"accelerated": True} if isinstance(drive, Accelerated) else {}
    if schedule is None:
        return accelerated
    return accelerated | {"schedule": SCHEDULE.kind.write(schedule, join(path, "schedule"))}
