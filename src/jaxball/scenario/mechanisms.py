"""The mechanisms of a scenario file: joints and the masses that they carry."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx

from ..physics.body import System
from ..physics.mechanisms import Accelerated, CarriedMass, Mechanism
from ..physics.schedules import AbstractSchedule
from .joints import JOINTS, ReadJoint, read_joint, write_joint
from .table import Key, Module, join, keys_of, read_list, read_table, write_member, write_table
from .values import LENGTH, POSITIVE, Integer, Nested, Numbers, ScenarioError

MOST_JOINTS = 10_000
_CARRIED = Module(
    CarriedMass,
    {
        "mass": Key(Numbers(rule=POSITIVE)),
        "place": Key(Numbers((3,), dimension=LENGTH), (0.0, 0.0, 0.0)),
        "joint": Key(Integer(0, MOST_JOINTS), None),
    },
)


def _read_joints(values: Any, path: str) -> list[ReadJoint]:
    return read_list(values, path, read_joint)


def _read_carried(values: Any, path: str) -> list[CarriedMass]:
    return read_list(values, path, _CARRIED.read)


def _written(tables: Any, path: str) -> Any:
    return tables


MECHANISM = {
    "joints": Key(Nested(_read_joints, _written, "a list of tables", keys_of(JOINTS))),
    "masses": Key(Nested(_read_carried, _written, "a list of tables", {"": _CARRIED.keys})),
}


class ReadMechanism(NamedTuple):
    """A mechanism, and for each joint the schedule that a law accelerating it follows, if there is one."""

    mechanism: Mechanism
    targets: tuple[AbstractSchedule | None, ...]

    def without_law(self) -> Mechanism:
        """The mechanism with its accelerated joints free: the same positions, without needing a law."""
        free = [
            eqx.tree_at(lambda j: j.drive, joint, None) if isinstance(joint.drive, Accelerated) else joint
            for joint in self.mechanism.joints
        ]
        return Mechanism(free, self.mechanism.masses)


class JointInState(NamedTuple):
    """A joint whose θ and θ̇ belong to the state: its path, whether a law accelerates it, and what it is to follow."""

    path: str
    accelerated: bool
    target: AbstractSchedule | None


def joints_in_state(mechanisms: Sequence[ReadMechanism]) -> list[JointInState]:
    """The joints whose θ and θ̇ belong to the state, in its order."""
    return [
        JointInState(f"mechanisms[{index}].joints[{a}]", a in item.mechanism.accelerated, item.targets[a])
        for index, item in enumerate(mechanisms)
        for a in item.mechanism.in_state
    ]


def read_mechanisms(values: Any, path: str) -> list[ReadMechanism]:
    """The mechanisms, one a table."""
    return read_list(values, path, _read_mechanism, empty=True)


def _read_mechanism(values: Any, path: str) -> ReadMechanism:
    table = read_table(values, path, MECHANISM)
    joints, targets = zip(*table["joints"], strict=True)
    try:
        mechanism = Mechanism(joints, table["masses"])
    except ValueError as error:  # of a misplaced joint or mass, which has the same name in a file
        raise ScenarioError(str(error).replace("Argument `", f"Key `{path}.", 1)) from None
    return ReadMechanism(mechanism, targets)


def write_mechanisms(system: System, targets: Mapping[str, AbstractSchedule | None], path: str) -> list[dict[str, Any]]:
    """The tables of the mechanisms; ``targets`` has the schedules that a law follows, by the path of the joint."""
    return [_write_mechanism(item, targets, f"{path}[{index}]") for index, item in enumerate(system.mechanisms)]


def _write_mechanism(item: Any, targets: Mapping[str, AbstractSchedule | None], path: str) -> dict[str, Any]:
    write_member(item, path, {"": Module(Mechanism, {})})  # raises for any other kind
    paths = [f"{path}.joints[{a}]" for a in range(item.n_joints)]
    joints = [write_joint(joint, targets.get(at), at) for joint, at in zip(item.joints, paths, strict=True)]
    masses = [
        _write_carried(mass, item.n_joints - 1, f"{join(path, 'masses')}[{index}]")
        for index, mass in enumerate(item.masses)
    ]
    return {"joints": joints, "masses": masses}


def _write_carried(mass: CarriedMass, last: int, path: str) -> dict[str, Any]:
    joint = None if mass.joint == last else mass.joint
    return write_table({"mass": mass.mass, "place": mass.place, "joint": joint}, path, _CARRIED.keys)
