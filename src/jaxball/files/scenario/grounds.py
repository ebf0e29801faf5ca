"""The ground of a scenario file: a plane, a surface of one of jaxball's kinds, or one of a user's class."""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

from ...physics.grounds import (
    Belt,
    Bowl,
    Cylinder,
    HeightField,
    MovingFrame,
    Paraboloid,
    ParametricSurface,
    SignedDistance,
    SphereOutside,
    TiltingPlane,
    Turn,
    Turntable,
    Washboard,
)
from ...physics.grounds.ground import AbstractGround, Ground
from ...physics.mechanisms import Accelerated
from ...physics.prescribed.motion import AbstractPrescribedMotion
from ...physics.prescribed.schedules import AbstractSchedule
from .errors import ScenarioError
from .mechanisms import JointInState
from .motions import MOTIONS, SCHEDULE, SCHEDULES, read_motion, write_motion
from .own import FUNCTION, Open, Parts, module_of, modules_of, read_open
from .table import Key, keys_of, read_list, read_one_of
from .values import Checked, Nested, require_conditions

_MOTION = Nested(lambda values, path: read_motion(*read_one_of(values, path, MOTIONS)), write_motion, tables=MOTIONS)
_SCHEDULED: Parts = {AbstractSchedule: SCHEDULE.kind}
_TURN = module_of(Turn, _SCHEDULED)
_TURNS = Nested(
    lambda values, path: read_list(values, path, _TURN.read),
    lambda turns, path: [_TURN.write(turn, f"{path}[{index}]") for index, turn in enumerate(turns)],
    "a list of tables",
    {"": _TURN.keys},
    forms=("list",),
)
_DISPLACED: Parts = {AbstractPrescribedMotion: _MOTION}
_PARTS: Parts = {
    **_DISPLACED,
    MovingFrame: module_of(MovingFrame, _DISPLACED, keys={"turns": Key(_TURNS, ())}).nested,
    Turntable: module_of(Turntable, _SCHEDULED).nested,
    Belt: module_of(Belt, _SCHEDULED).nested,
}
GROUND = module_of(Ground, _PARTS)


@dataclasses.dataclass(frozen=True)
class AnglesOfPlate(Checked):
    """Names of angles of a plate, in their order."""

    names: tuple[str, ...] = ("about_e1", "about_e2")
    words: str = 'one or both of the names "about_e1" and "about_e2" in a list, in this order'

    def fits(self, value: Any) -> bool:
        return isinstance(value, list) and value != [] and value == [name for name in self.names if name in value]

    def write(self, value: Any, path: str) -> list[str] | None:
        return list(value) or None


class ReadPlate(NamedTuple):
    """A plate, and for each of its angles that a law accelerates the schedule that it follows, if there is one."""

    ground: TiltingPlane
    targets: tuple[AbstractSchedule | None, ...]

    @property
    def angles(self) -> list[JointInState]:
        """The angles whose values and rates belong to the state, in its order."""
        names = self.ground.driven
        return [JointInState(f"ground.{name}", True, target) for name, target in zip(names, self.targets, strict=True)]

    def without_law(self) -> TiltingPlane:
        """Returns the plate with the angles that a law accelerates level, which needs no law."""
        return dataclasses.replace(self.ground, **dict.fromkeys(self.ground.driven))


def _read_plate(accelerated: tuple[str, ...] = (), **values: Any) -> ReadPlate:
    drives: dict[str, Any] = {name: Accelerated() for name in accelerated}
    return ReadPlate(TiltingPlane(**values | drives), tuple(values.get(name) for name in accelerated))


def _write_angle(angle: AbstractSchedule | Accelerated, path: str) -> dict[str, Any] | None:
    """Returns the table of an angle's schedule; where a law accelerates the angle, the schedule is the law's, see
    :func:`write_targets`.
    """
    return None if isinstance(angle, Accelerated) else SCHEDULE.kind.write(angle, path)


_ANGLE = Nested(SCHEDULE.kind.read, _write_angle, SCHEDULE.kind.words, keys_of(SCHEDULES))


def write_targets(targets: Mapping[str, AbstractSchedule | None]) -> dict[str, Any]:
    """Returns the schedules that a law follows with the angles of a plate, as further keys of the table [ground]."""
    paths = {name: f"ground.{name}" for name in AnglesOfPlate.names}
    followed = {name: (path, targets.get(path)) for name, path in paths.items()}
    return {name: SCHEDULE.kind.write(target, path) for name, (path, target) in followed.items() if target is not None}


_PLATE = module_of(TiltingPlane, {AbstractSchedule | Accelerated: _ANGLE, **_PARTS})
_OF_FUNCTION = {"height-field": HeightField, "parametric": ParametricSurface, "signed-distance": SignedDistance}
_SURFACES = {
    "bowl": Bowl,
    "sphere": SphereOutside,
    "cylinder": Cylinder,
    "paraboloid": Paraboloid,
    "washboard": Washboard,
}
GROUNDS = Open(
    AbstractGround,
    {
        "": GROUND,
        **{name: module_of(kind, _PARTS, keys=FUNCTION) for name, kind in _OF_FUNCTION.items()},
        **modules_of(_SURFACES, _PARTS),
        "tilting-plane": dataclasses.replace(
            _PLATE,
            keys={
                **_PLATE.keys,
                "accelerated": Key(AnglesOfPlate(), None, says="the angles whose θ̈ the law of [actuation] gives"),
            },
            build=_read_plate,
            attributes={"accelerated": "driven"},
        ),
    },
    parts=_PARTS,
)


_TABLE_REFUSED = {
    "disk": "a disk, which rolls on a line",
    "convex-body": "a convex body, whose contact point is not under its centre",
}


def read_ground(values: Any, path: str, kind: str) -> AbstractGround | ReadPlate:
    """Reads the ground, a plate with the schedules that a law follows; only under a ball may it have a turntable."""
    has_kind = isinstance(values, dict) and "kind" in values
    ground = read_open(values, path, GROUNDS) if has_kind else GROUND.read(values, path)
    if kind == "convex-body" and not isinstance(ground, Ground):
        raise ScenarioError(
            f"Key `{path}` must be a plane under a convex body, whose contact with another ground would have to be "
            f"searched for; give `{path}.angle`, leave it out, or use a ball."
        )
    seen = ground.ground if isinstance(ground, ReadPlate) else ground
    if seen.turntable is not None and kind in _TABLE_REFUSED:
        raise ScenarioError(f"Key `{path}.turntable` must be left out for {_TABLE_REFUSED[kind]}; use a ball.")
    require_conditions(seen)
    return ground
