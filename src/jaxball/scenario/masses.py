"""The point masses of a scenario file, and who moves them."""

from typing import Any

from ..physics.body import PointMass, System
from ..physics.motion import Driven, Fixed, OnRail, Oscillating
from ..physics.schedules import AbstractSchedule
from .actuation import targets_of
from .harmonics import OSCILLATING
from .rails import RAILS
from .schedules import SCHEDULES
from .table import Key, join, member_of, read_list, read_one_of
from .values import LENGTH, POSITIVE, Numbers, ScenarioError

MASS = Key(Numbers(rule=POSITIVE))
RAIL = Key(member_of(RAILS))
SCHEDULE = Key(member_of(SCHEDULES))
POSITION = Key(Numbers((3,), dimension=LENGTH))
FREE = Key(OSCILLATING.nested)

CHOICES = {
    "rail": {"mass": MASS, "rail": RAIL, "schedule": SCHEDULE},
    "position": {"mass": MASS, "position": POSITION},
    "free": {"mass": MASS, "free": FREE},
}


def read_masses(values: Any, path: str) -> list[PointMass]:
    """The masses, those on rails with the motion that their schedules prescribe."""
    return read_list(values, path, _read_mass, empty=True)


def _read_mass(values: Any, path: str) -> PointMass:
    kind, table = read_one_of(values, path, CHOICES)
    if kind == "rail":
        return PointMass(table["mass"], OnRail(table["rail"], table["schedule"]))
    return PointMass(table["mass"], Fixed(table["position"]) if kind == "position" else table["free"])


def write_masses(system: System, path: str) -> list[dict[str, Any]]:
    """The tables of the masses; a mass that is driven by a law has the law's target as its schedule."""
    targets = dict(zip(system.driven, targets_of(system.law), strict=True))
    return [_write_mass(item, targets.get(index), f"{path}[{index}]") for index, item in enumerate(system.point_masses)]


def _write_mass(item: PointMass, target: AbstractSchedule | None, path: str) -> dict[str, Any]:
    motion, table = item.motion, {"mass": MASS.kind.write(item.mass, path)}
    if isinstance(motion, Fixed):
        return {**table, "position": POSITION.kind.write(motion.position, path)}
    if isinstance(motion, Oscillating):
        return {**table, "free": FREE.kind.write(motion, join(path, "free"))}
    if isinstance(motion, OnRail | Driven):
        schedule = motion.schedule if isinstance(motion, OnRail) else target
        return {
            **table,
            "rail": RAIL.kind.write(motion.rail, join(path, "rail")),
            "schedule": SCHEDULE.kind.write(schedule, join(path, "schedule")),
        }
    raise ScenarioError(
        f"Key `{path}` must be on a rail, at a position or oscillating to be written to a file, but its "
        f"motion is a {type(motion).__name__}; keep a scenario that has Python functions as a Python script."
    )
