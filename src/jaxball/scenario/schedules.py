"""The schedules that a scenario file can hold, and their keys."""

from collections.abc import Callable
from typing import Any

from ..interface.arguments import require_function
from ..interface.wording import counted
from ..numerics.arrays import a_number
from ..physics.schedules import AbstractSchedule, ConstantRate, PiecewiseAcceleration, Pulse, Waypoints
from .harmonics import SINUSOIDS
from .own import Open
from .table import Family, Key, Module, join, member_of
from .traced import require
from .values import ACCELERATION, ANGLE, INCREASING, RATE, TIME, Numbers, key_error

THETA = Key(Numbers(dimension=ANGLE))
NO_RATE = Key(Numbers(dimension=RATE), 0.0)
TIMES = Numbers((None,), INCREASING, TIME)


def _check_pulse(table: dict[str, Any], path: str) -> None:
    for earlier, later, must in (("start", "hold", "not before"), ("hold", "end", "later than")):
        first, second = table[earlier], table[later]
        holds = second > first if later == "end" else second >= first
        require(holds, join(path, later), f"{must} `{earlier}` = {first!r}", lambda second=second: repr(second))


def row_for_each_interval(name: str, entry: str = "row") -> Callable[[dict[str, Any], str], None]:
    """The check that the list ``name`` of a table has an ``entry`` for each interval between its ``times``."""

    def check(table: dict[str, Any], path: str) -> None:
        times, rows = len(table["times"]), len(table[name])
        if times != rows + 1:
            must = f"a list with a {entry} for each interval between the {times} `times`"
            raise key_error(join(path, name), must, f"one of {counted(rows, entry)}")

    return check


def _check_waypoints(table: dict[str, Any], path: str) -> None:
    times, angles = len(table["times"]), len(table["angles"])
    if times < 2:
        raise key_error(join(path, "times"), "a list of two times or more", f"one of {times}")
    if angles != times:
        raise key_error(
            join(path, "angles"),
            f"as long as `times`, which has {counted(times, 'entry', 'entries')}",
            f"one of {angles}",
        )


def _check_schedule(schedule: AbstractSchedule) -> None:
    require_function("schedule", schedule.__call__, (), t=a_number())


_FAMILIES: Family = {
    "pulse": Module(
        Pulse,
        {
            "theta": THETA,
            "height": Key(Numbers(dimension=ACCELERATION), 1.0),
            "rate": NO_RATE,
            "start": Key(Numbers(dimension=TIME), 0.0),
            "hold": Key(Numbers(dimension=TIME), 0.1),
            "end": Key(Numbers(dimension=TIME), 0.2),
        },
        check=_check_pulse,
    ),
    "constant-rate": Module(ConstantRate, {"theta": THETA, "rate": NO_RATE}),
    "sinusoids": SINUSOIDS,
    "piecewise-acceleration": Module(
        PiecewiseAcceleration,
        {
            "theta": THETA,
            "rate": NO_RATE,
            "times": Key(TIMES),
            "accelerations": Key(Numbers((None, None), dimension=ACCELERATION)),
        },
        check=row_for_each_interval("accelerations"),
    ),
    "waypoints": Module(
        Waypoints,
        {
            "times": Key(TIMES),
            "angles": Key(Numbers((None,), dimension=ANGLE)),
            "end_rates": Key(Numbers((2,), dimension=RATE), (0.0, 0.0)),
        },
        check=_check_waypoints,
    ),
}
SCHEDULES = Open(AbstractSchedule, _FAMILIES, _check_schedule)
SCHEDULE = Key(member_of(SCHEDULES))
