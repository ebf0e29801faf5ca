"""The ground of a scenario file: its tilt, its motion and its turntable."""

from typing import Any

from ..physics.ground import Ground, Turntable
from .masses import MOTIONS, read_motion, write_motion
from .schedules import SCHEDULE
from .table import Key, Module, read_one_of
from .traced import require_conditions
from .values import ANGLE, FULL_TURN, LENGTH, QUARTER_TURN, Nested, Numbers, Radians, ScenarioError


def _read_motion(values: Any, path: str) -> Any:
    return read_motion(*read_one_of(values, path, MOTIONS))


_TURNTABLE = Module(Turntable, {"turning": SCHEDULE, "centre": Key(Numbers((2,), dimension=LENGTH), (0.0, 0.0))})
GROUND = Module(
    Ground,
    {
        "angle": Key(Radians((), QUARTER_TURN, ANGLE), 0.0),
        "heading": Key(Radians((), FULL_TURN, ANGLE), 0.0),
        "motion": Key(Nested(_read_motion, write_motion, tables=MOTIONS), None),
        "turntable": Key(_TURNTABLE.nested, None),
    },
)


def read_ground(values: Any, path: str, kind: str) -> Ground:
    """The ground; under a disk it has no turntable."""
    ground = GROUND.read(values, path)
    if kind == "disk" and ground.turntable is not None:
        raise ScenarioError(f"Key `{path}.turntable` must be left out for a disk, which rolls on a line; use a ball.")
    require_conditions(ground)
    return ground
