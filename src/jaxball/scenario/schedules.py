"""The schedules that a scenario file can hold, and their keys."""

from typing import Any

from ..interface.wording import counted
from ..physics.schedules import ConstantRate, PiecewiseAcceleration, Pulse, Waypoints
from .harmonics import SINUSOIDS
from .table import Family, Key, Module, join
from .values import INCREASING, Numbers, key_error

NUMBER = Numbers()
TIMES = Numbers((None,), INCREASING)


def _check_pulse(found: dict[str, Any], path: str) -> None:
    for earlier, later, must in (("start", "hold", "not before"), ("hold", "end", "later than")):
        first, second = float(found[earlier]), float(found[later])
        if second < first or (second == first and later == "end"):
            raise key_error(join(path, later), f"{must} `{earlier}` = {first!r}", repr(second))


def _check_pieces(found: dict[str, Any], path: str) -> None:
    times, rows = len(found["times"]), len(found["accelerations"])
    if times != rows + 1:
        raise key_error(
            join(path, "accelerations"),
            f"a list with a row for each interval between the {times} `times`",
            f"one of {counted(rows, 'row')}",
        )


def _check_waypoints(found: dict[str, Any], path: str) -> None:
    times, angles = len(found["times"]), len(found["angles"])
    if times < 2:
        raise key_error(join(path, "times"), "a list of two times or more", f"one of {times}")
    if angles != times:
        raise key_error(
            join(path, "angles"),
            f"as long as `times`, which has {counted(times, 'entry', 'entries')}",
            f"one of {angles}",
        )


SCHEDULES: Family = {
    "pulse": Module(
        Pulse,
        {
            "theta": Key(NUMBER),
            "height": Key(NUMBER, 1.0),
            "rate": Key(NUMBER, 0.0),
            "start": Key(NUMBER, 0.0),
            "hold": Key(NUMBER, 0.1),
            "end": Key(NUMBER, 0.2),
        },
        check=_check_pulse,
    ),
    "constant-rate": Module(ConstantRate, {"theta": Key(NUMBER), "rate": Key(NUMBER, 0.0)}),
    "sinusoids": SINUSOIDS,
    "piecewise-acceleration": Module(
        PiecewiseAcceleration,
        {
            "theta": Key(NUMBER),
            "rate": Key(NUMBER, 0.0),
            "times": Key(TIMES),
            "accelerations": Key(Numbers((None, None))),
        },
        check=_check_pieces,
    ),
    "waypoints": Module(
        Waypoints,
        {"times": Key(TIMES), "angles": Key(Numbers((None,))), "end_rates": Key(Numbers((2,)), (0.0, 0.0))},
        check=_check_waypoints,
    ),
}
