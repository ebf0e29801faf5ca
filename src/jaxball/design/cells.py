"""Numbers as they stand in reports and on the command line."""

import math
from collections.abc import Mapping

from ..physics.body import System
from .objectives import AbstractObjective


def violation(by: float, allowed: float) -> str:
    """Whether a constraint holds, by its largest signed violation and what is allowed."""
    if math.isnan(by):
        return "not known"
    if by == -math.inf:
        return "nothing to look at"
    if by > allowed:
        return f"violated by {by:.2e}"
    return f"holds, but for {by:.1e}" if by > 0 else f"holds, margin {abs(by):.2e}"


def bounds(lower: float, upper: float) -> str:
    """Between which bounds a variable may be."""
    if lower == -math.inf:
        return "free" if upper == math.inf else f"at most {upper:g}"
    return f"at least {lower:g}" if upper == math.inf else f"{lower:g} to {upper:g}"


def duration(seconds: float) -> str:
    """A time in hours, minutes and seconds."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{seconds:.1f} s"


def in_units(
    objectives: Mapping[str, AbstractObjective], values: Mapping[str, float], system: System
) -> dict[str, str]:
    """The length, the angle or the time that the value of an objective stands for, in units of the scenario.

    Empty where it stands for none, or is not finite.
    """
    length, gravity = float(system.radius), abs(float(system.gravity))
    time = math.sqrt(length / gravity) if gravity > 0 else math.inf
    return {
        name: objective.in_units(values[name], length, time) if math.isfinite(values[name]) else ""
        for name, objective in objectives.items()
    }
