"""The times of a scenario file."""

from typing import Any

import numpy as np

from .table import Key, read_one_of
from .values import INCREASING, POSITIVE, Integer, Numbers, key_error

MOST_SAVES = 10_000_000
_SPAN = {"start": Key(Numbers()), "end": Key(Numbers())}
TIMES = {
    "saves": {**_SPAN, "saves": Key(Integer(2, MOST_SAVES))},
    "step": {**_SPAN, "step": Key(Numbers(rule=POSITIVE))},
    "at": {"at": Key(Numbers((None,), INCREASING))},
}


def read_times(values: Any, path: str) -> np.ndarray:
    """The save times, by their number, by the step between them, or one by one."""
    choice, found = read_one_of(values, path, TIMES)
    if choice == "at":
        if found["at"].size < 2:
            raise key_error(f"{path}.at", "a list of two times or more", str(found["at"].tolist()))
        _check_span(float(found["at"][0]), float(found["at"][-1]), f"{path}.at")
        return found["at"]
    start, end = float(found["start"]), float(found["end"])
    if not end > start:
        raise key_error(f"{path}.end", f"later than `start` = {start!r}", repr(end))
    _check_span(start, end, f"{path}.end")
    if choice == "saves":
        times = np.linspace(start, end, found["saves"])
        if not np.all(np.diff(times) > 0):
            raise key_error(f"{path}.saves", "few enough for the times to differ", repr(found["saves"]))
        return times
    step = float(found["step"])
    intervals = (end - start) / step
    if intervals > MOST_SAVES or round(intervals) < 1 or abs(intervals - round(intervals)) > 1e-9 * intervals:
        raise key_error(
            f"{path}.step",
            f"a whole part of the span from {start!r} to {end!r}, and not less than a {MOST_SAVES}th of it",
            repr(step),
        )
    return np.linspace(start, end, round(intervals) + 1)


def _check_span(start: float, end: float, path: str) -> None:
    if not np.isfinite(end - start):
        raise key_error(path, "times whose differences are finite numbers", f"from {start!r} to {end!r}")


def write_times(times: np.ndarray) -> dict[str, Any]:
    """The table [time]: the number of equally spaced times, or else every time."""
    even = np.linspace(times[0], times[-1], times.size)
    if np.array_equal(times, even):
        return {"start": float(times[0]), "end": float(times[-1]), "saves": int(times.size)}
    return {"at": times.tolist()}
