"""The mechanisms of a scenario file: joints, their forces, and the masses that they carry."""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx

from ...physics.body import System
from ...physics.mechanisms import (
    AbstractJoint,
    AbstractJointForce,
    Accelerated,
    Carriage,
    CarriedMass,
    Damper,
    Drive,
    EndStops,
    HardStops,
    Hinge,
    JointForces,
    JointFriction,
    MajdSimaanFriction,
    Mechanism,
    Motor,
    PDServo,
    Slider,
    SpeedLimitedMotor,
    Spring,
)
from ...physics.prescribed.rails import AbstractRail
from ...physics.prescribed.schedules import AbstractSchedule
from ...physics.prescribed.signals import AbstractSignal
from .errors import ScenarioError, describe, key_error
from .motions import RAIL, SCHEDULE, SIGNAL
from .own import Open, Parts, module_of, modules_of
from .table import (
    Family,
    Key,
    Keys,
    Module,
    join,
    keys_of,
    read_family,
    read_list,
    read_table,
    write_family,
    write_member,
    write_table,
)
from .values import Flag, Integer, Nested, require_conditions

MOST_EXPONENT = 100

_DRIVING: Parts = {AbstractSignal | AbstractSchedule: SIGNAL, AbstractSchedule: SCHEDULE.kind}
JOINT_FORCES = Open(
    AbstractJointForce,
    {
        **modules_of(
            {
                "motor": Motor,
                "spring": Spring,
                "damper": Damper,
                "speed-limited-motor": SpeedLimitedMotor,
                "pd-servo": PDServo,
                "end-stops": EndStops,
                "hard-stops": HardStops,
                "majd-simaan-friction": MajdSimaanFriction,
            },
            _DRIVING,
        ),
        "joint-friction": module_of(JointFriction, keys={"exponent": Key(Integer(1, MOST_EXPONENT), 2)}),
    },
    parts=_DRIVING,
)
_FORCE_WORDS = "a table, or a list of tables whose forces add up"


def read_forces(values: Any, path: str) -> AbstractJointForce:
    """Reads a force on a joint, or the sum of the forces in a list."""
    if isinstance(values, list):
        return JointForces(tuple(read_list(values, path, _read_force, empty=True)))
    if not isinstance(values, dict):
        raise key_error(path, _FORCE_WORDS, describe(values))
    return _read_force(values, path)


def _read_force(values: Any, path: str) -> AbstractJointForce:
    force = read_family(values, path, JOINT_FORCES)
    require_conditions(force, "", path)
    return force


def write_forces(force: AbstractJointForce, path: str) -> Any:
    """Returns the table of a force on a joint, or the list of the tables of a sum's forces."""
    if isinstance(force, JointForces):
        return [write_family(term, f"{path}[{index}]", JOINT_FORCES) for index, term in enumerate(force.terms)]
    return write_family(force, path, JOINT_FORCES)


_FORCE = Key(
    Nested(read_forces, write_forces, _FORCE_WORDS, keys_of(JOINT_FORCES), forms=("item", "list")),
    None,
    says="a force on it, or several that add up",
)


MOST_JOINTS = 10_000

_ON = Key(Integer(-1, MOST_JOINTS), None)
_GEOMETRY: Family = {
    name: module_of(joint, {AbstractRail: RAIL.kind}, keys={"on": _ON})
    for name, joint in {"hinge": Hinge, "slider": Slider, "carriage": Carriage}.items()
}
_DRIVES = {
    "schedule": Key(SCHEDULE.kind, None, "θ(t); if the joint is `accelerated`, the one that the law follows"),
    "force": _FORCE,
    "accelerated": Key(Flag(), False, "whether the law of [actuation] gives its θ̈"),
}


def _make_joint(
    kind: type, accelerated: bool, schedule=None, force=None, **geometry: Any
) -> tuple[AbstractJoint, AbstractSchedule | None]:
    """Makes a joint, and returns the schedule that a law accelerating it follows too, if there is one."""
    drive = Accelerated() if accelerated else schedule if force is None else force
    return kind(**geometry, drive=drive), schedule if accelerated else None


def _check_drive(table: dict[str, Any], path: str) -> None:
    if table["force"] is None:
        return
    for name in ("schedule", "accelerated"):
        if table[name]:
            raise ScenarioError(
                f"Key `{join(path, name)}` must not be combined with `force`, because a joint moves either by a "
                "prescribed motion or under forces; leave one of them out."
            )


_DRIVE = {"drive": "one of `schedule`, `force`, `accelerated`"}
JOINTS: Family = {
    kind: Module(
        module.type,
        {**module.keys, **_DRIVES},
        build=functools.partial(_make_joint, module.type),
        check=_check_drive,
        elsewhere=_DRIVE,
    )
    for kind, module in _GEOMETRY.items()
}


def _write_drive(drive: Drive, target: AbstractSchedule | None, path: str) -> dict[str, Any]:
    """Returns the keys of the drive of a joint, with the ``target`` that a law gives it."""
    if isinstance(drive, AbstractJointForce):
        return {"force": _FORCE.kind.write(drive, join(path, "force"))}
    schedule = target if isinstance(drive, Accelerated) else drive
    accelerated = {"accelerated": True} if isinstance(drive, Accelerated) else {}
    if schedule is None:
        return accelerated
    return accelerated | {"schedule": SCHEDULE.kind.write(schedule, join(path, "schedule"))}


_CARRIED = module_of(CarriedMass, keys={"joint": Key(Integer(0, MOST_JOINTS), None)})


def _tables(read: Callable[[Any, str], Any], tables: Mapping[str, Keys], says: str) -> Key:
    """Describes a list of tables, each read by ``read``, and written where the whole is."""
    return Key(
        Nested(
            lambda values, path: read_list(values, path, read),
            lambda item, path: item,
            "a list of tables",
            tables,
            forms=("list",),
        ),
        says=says,
    )


MECHANISM = {
    "joints": _tables(
        lambda values, path: read_family(values, path, JOINTS),
        keys_of(JOINTS),
        "the joints, each under [[mechanisms.joints]]",
    ),
    "masses": _tables(_CARRIED.read, {"": _CARRIED.keys}, "the masses on the joints, each under [[mechanisms.masses]]"),
}


class ReadMechanism(NamedTuple):
    """A mechanism, and for each joint the schedule that a law accelerating it follows, if there is one."""

    mechanism: Mechanism
    targets: tuple[AbstractSchedule | None, ...]

    def without_law(self) -> Mechanism:
        """Returns the mechanism with its accelerated joints free: the same positions, without needing a law."""
        free = [
            eqx.tree_at(lambda j: j.drive, joint, None) if isinstance(joint.drive, Accelerated) else joint
            for joint in self.mechanism.joints
        ]
        return Mechanism(free, self.mechanism.masses)


class JointInState(NamedTuple):
    """A joint whose θ and θ̇ belong to the state: its path, whether a law accelerates it, and what it is to follow.

    So do angles of a plate, each of which is a key that has its schedule.
    """

    path: str
    accelerated: bool
    target: AbstractSchedule | None

    @property
    def schedule(self) -> str:
        """The path of its schedule."""
        return self.path if self.path.startswith("ground.") else f"{self.path}.schedule"


def joints_in_state(mechanisms: Sequence[ReadMechanism]) -> list[JointInState]:
    """Lists the joints whose θ and θ̇ belong to the state, in its order."""
    return [
        JointInState(f"mechanisms[{index}].joints[{a}]", a in item.mechanism.accelerated, item.targets[a])
        for index, item in enumerate(mechanisms)
        for a in item.mechanism.in_state
    ]


def read_mechanisms(values: Any, path: str) -> list[ReadMechanism]:
    """Reads the mechanisms, one a table."""
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
    """Returns the tables of the mechanisms; ``targets`` has the schedules that a law follows, by the path of
    the joint.
    """
    return [_write_mechanism(item, targets, f"{path}[{index}]") for index, item in enumerate(system.mechanisms)]


def _write_mechanism(item: Any, targets: Mapping[str, AbstractSchedule | None], path: str) -> dict[str, Any]:
    write_member(item, path, {"": Module(Mechanism, {})})  # raises for any other kind
    paths = [f"{path}.joints[{a}]" for a in range(item.n_joints)]
    joints = [
        write_family(joint, joint_path, _GEOMETRY) | _write_drive(joint.drive, targets.get(joint_path), joint_path)
        for joint, joint_path in zip(item.joints, paths, strict=True)
    ]
    masses = [
        _write_carried_mass(mass, item.n_joints - 1, f"{join(path, 'masses')}[{index}]")
        for index, mass in enumerate(item.masses)
    ]
    return {"joints": joints, "masses": masses}


def _write_carried_mass(mass: CarriedMass, last: int, path: str) -> dict[str, Any]:
    # The last joint is the default.
    joint = None if mass.joint == last else mass.joint
    return write_table({"mass": mass.mass, "place": mass.place, "joint": joint}, path, _CARRIED.keys)
