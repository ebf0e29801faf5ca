"""The ground of a scenario file: a plane, a surface of one of jaxball's kinds, or one of a user's class."""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

from ..numerics.declare import ANGLE, FULL_TURN, LENGTH, PER_LENGTH, POSITIVE, QUARTER_TURN, TIME
from ..physics.grounds import (
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
from ..physics.grounds.ground import AbstractGround, Ground
from ..physics.mechanisms import Accelerated
from ..physics.prescribed.schedules import AbstractSchedule
from .errors import ScenarioError, describe, key_error
from .mechanisms import JointInState
from .motions import MOTIONS, SCHEDULE, SCHEDULES, read_motion, write_motion
from .own import FUNCTION, Open, names_own, read_own, trying
from .table import Key, Keys, Module, join, keys_of, read_family, read_list, read_one_of
from .values import Flag, Nested, Numbers, require_conditions

_MOTION = Nested(lambda values, path: read_motion(*read_one_of(values, path, MOTIONS)), write_motion, tables=MOTIONS)
_CENTRE = Key(Numbers((2,), dimension=LENGTH), (0.0, 0.0))
_CARRIERS = {
    "turntable": Key(Module(Turntable, {"turning": SCHEDULE, "centre": _CENTRE}).nested, None),
    "belt": Key(Module(Belt, {"travel": SCHEDULE, "heading": Key(Radians((), FULL_TURN, ANGLE), 0.0)}).nested, None),
}
GROUND = Module(
    Ground,
    {
        "angle": Key(Numbers((), QUARTER_TURN, ANGLE), 0.0),
        "heading": Key(Numbers((), FULL_TURN, ANGLE), 0.0),
        "motion": Key(_MOTION, None),
        **_CARRIERS,
    },
)

_ORIGIN = Key(Numbers((3,), dimension=LENGTH), (0.0, 0.0, 0.0))
_TURN = Module(Turn, {"axis": Key(Numbers((3,))), "angle": SCHEDULE})
_TURNS = Nested(
    lambda values, path: read_list(values, path, _TURN.read),
    lambda turns, path: [_TURN.write(turn, f"{path}[{index}]") for index, turn in enumerate(turns)],
    "a list of tables",
    {"": _TURN.keys},
)
_FRAME = Module(MovingFrame, {"turns": Key(_TURNS, ()), "displacement": Key(_MOTION, None), "pivot": _ORIGIN})
_MOVED = {"motion": Key(_FRAME.nested, None), **_CARRIERS}
_RADIUS = Key(Numbers(rule=POSITIVE, dimension=LENGTH))
_OF_FUNCTION = {**FUNCTION, "kink_times": Key(Numbers((None,), dimension=TIME), ())}


_ANGLES = ("about_e1", "about_e2")  # of a plate


@dataclasses.dataclass(frozen=True)
class _AnglesOfPlate:
    """Names of angles of a plate, in their order."""

    words: str = 'a list of "about_e1", "about_e2" or both, in this order'

    def read(self, value: Any, path: str) -> tuple[str, ...]:
        if not isinstance(value, list) or not value or value != [name for name in _ANGLES if name in value]:
            raise key_error(path, self.words, describe(value))
        return tuple(value)

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


_ANGLE = Key(Nested(SCHEDULE.kind.read, _write_angle, SCHEDULE.kind.words, keys_of(SCHEDULES)), None)


def write_targets(targets: Mapping[str, AbstractSchedule | None]) -> dict[str, Any]:
    """Returns the schedules that a law follows with the angles of a plate, as further keys of the table [ground]."""
    paths = {name: f"ground.{name}" for name in _ANGLES}
    followed = {name: (path, targets.get(path)) for name, path in paths.items()}
    return {name: SCHEDULE.kind.write(target, path) for name, (path, target) in followed.items() if target is not None}


def _surface(kind: type, keys: Keys) -> Module:
    """Describes in a file a surface that may move as a whole."""
    return Module(kind, {**keys, **_MOVED})


GROUNDS = Open(
    AbstractGround,
    {
        "": GROUND,
        "height-field": _surface(HeightField, _OF_FUNCTION),
        "parametric": _surface(ParametricSurface, _OF_FUNCTION),
        "signed-distance": _surface(
            SignedDistance,
            {
                **_OF_FUNCTION,
                "centre": Key(Numbers((3,), dimension=LENGTH), None),
                "guess": Key(Numbers(dimension=LENGTH), 0.0),
            },
        ),
        "bowl": _surface(Bowl, {"radius": _RADIUS}),
        "sphere": _surface(SphereOutside, {"radius": _RADIUS}),
        "cylinder": _surface(
            Cylinder,
            {
                "radius": _RADIUS,
                "axis": Key(Numbers((3,)), (1.0, 0.0, 0.0)),
                "start": Key(Numbers((3,)), (0.0, 0.0, -1.0)),
                "centre": _ORIGIN,
                "outside": Key(Flag(), False),
            },
        ),
        "paraboloid": _surface(Paraboloid, {"curvatures": Key(Numbers((2,), dimension=PER_LENGTH, by_size=True))}),
        "washboard": _surface(
            Washboard,
            {
                "amplitude": Key(Numbers(dimension=LENGTH)),
                "wavelength": Key(Numbers(rule=POSITIVE, dimension=LENGTH)),
                "phase": Key(Numbers((), FULL_TURN, ANGLE), 0.0),
                "heading": Key(Numbers((), FULL_TURN, ANGLE), 0.0),
            },
        ),
        "tilting-plane": Module(
            TiltingPlane,
            {
                "about_e1": _ANGLE,
                "about_e2": _ANGLE,
                "accelerated": Key(_AnglesOfPlate(), None),
                "pivot": _ORIGIN,
                "displacement": Key(_MOTION, None),
                **_CARRIERS,
            },
            build=_read_plate,
            attributes={"accelerated": "driven"},
        ),
    },
)


_TABLE_REFUSED = {
    "disk": "a disk, which rolls on a line",
    "convex-body": "a convex body, whose contact point is not under its centre",
}


def read_ground(values: Any, path: str, kind: str) -> AbstractGround | ReadPlate:
    """Reads the ground, a plate with the schedules that a law follows; only under a ball may it have a turntable."""
    if names_own(values):
        ground = read_own(values, path, GROUNDS)
    elif isinstance(values, dict) and "kind" in values:
        with trying(join(path, "function")):
            ground = read_family(values, path, GROUNDS)
    else:
        ground = GROUND.read(values, path)
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
