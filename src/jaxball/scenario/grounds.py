"""The ground of a scenario file: a plane, a surface of one of jaxball's kinds, or one of a user's class."""

from typing import Any

from ..physics.grounds import (
    Bowl,
    Cylinder,
    HeightField,
    MovingFrame,
    Paraboloid,
    ParametricSurface,
    SphereOutside,
    TiltingPlane,
    Turn,
    Washboard,
)
from ..physics.grounds.ground import AbstractGround, Ground, Turntable
from .mechanisms import MOTIONS, read_motion, write_motion
from .motions import SCHEDULE
from .own import FUNCTION, Open, names_own, read_own, trying
from .table import Key, Keys, Module, join, read_family, read_list, read_one_of
from .values import (
    ANGLE,
    FULL_TURN,
    LENGTH,
    POSITIVE,
    QUARTER_TURN,
    TIME,
    Flag,
    Nested,
    Numbers,
    Radians,
    ScenarioError,
    require_conditions,
)

_MOTION = Nested(lambda values, path: read_motion(*read_one_of(values, path, MOTIONS)), write_motion, tables=MOTIONS)
_TURNTABLE = Module(Turntable, {"turning": SCHEDULE, "centre": Key(Numbers((2,), dimension=LENGTH), (0.0, 0.0))})
GROUND = Module(
    Ground,
    {
        "angle": Key(Radians((), QUARTER_TURN, ANGLE), 0.0),
        "heading": Key(Radians((), FULL_TURN, ANGLE), 0.0),
        "motion": Key(_MOTION, None),
        "turntable": Key(_TURNTABLE.nested, None),
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
_MOVED = {"motion": Key(_FRAME.nested, None)}
_RADIUS = Key(Numbers(rule=POSITIVE, dimension=LENGTH))
_OF_FUNCTION = {**FUNCTION, "kink_times": Key(Numbers((None,), dimension=TIME), ())}


def _surface(kind: type, keys: Keys) -> Module:
    """A surface that may move as a whole."""
    return Module(kind, {**keys, **_MOVED})


GROUNDS = Open(
    AbstractGround,
    {
        "": GROUND,
        "height-field": _surface(HeightField, _OF_FUNCTION),
        "parametric": _surface(ParametricSurface, _OF_FUNCTION),
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
        "paraboloid": _surface(Paraboloid, {"curvatures": Key(Numbers((2,)))}),
        "washboard": _surface(
            Washboard,
            {
                "amplitude": Key(Numbers(dimension=LENGTH)),
                "wavelength": Key(Numbers(rule=POSITIVE, dimension=LENGTH)),
                "phase": Key(Radians((), FULL_TURN, ANGLE), 0.0),
                "heading": Key(Radians((), FULL_TURN, ANGLE), 0.0),
            },
        ),
        "tilting-plane": Module(
            TiltingPlane,
            {
                "about_e1": Key(SCHEDULE.kind, None),
                "about_e2": Key(SCHEDULE.kind, None),
                "pivot": _ORIGIN,
                "displacement": Key(_MOTION, None),
            },
        ),
    },
)


def read_ground(values: Any, path: str, kind: str) -> AbstractGround:
    """The ground; under a disk it has no turntable."""
    if names_own(values):
        ground = read_own(values, path, GROUNDS)
    elif isinstance(values, dict) and "kind" in values:
        with trying(join(path, "function")):
            ground = read_family(values, path, GROUNDS)
    else:
        ground = GROUND.read(values, path)
    if kind == "disk" and isinstance(ground, Ground) and ground.turntable is not None:
        raise ScenarioError(f"Key `{path}.turntable` must be left out for a disk, which rolls on a line; use a ball.")
    require_conditions(ground)
    return ground
