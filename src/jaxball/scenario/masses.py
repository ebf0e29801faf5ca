"""The point masses of a scenario file, and what moves them."""

from collections.abc import Mapping
from typing import Any

from ..physics.body import PointMass, System
from ..physics.motion import AbstractMotion, Driven, Fixed, OnRail, Oscillating
from ..physics.schedules import AbstractSchedule
from .harmonics import OSCILLATING
from .rails import RAILS
from .schedules import SCHEDULE
from .table import Key, join, member_of, read_list, read_one_of
from .values import LENGTH, POSITIVE, Numbers, ScenarioError

MASS = Key(Numbers(rule=POSITIVE))
RAIL = Key(member_of(RAILS))
POSITION = Key(Numbers((3,), dimension=LENGTH))
FREE = Key(OSCILLATING.nested)

MOTIONS = {
    "rail": {"rail": RAIL, "schedule": SCHEDULE},
    "position": {"position": POSITION},
    "free": {"free": FREE},
}
_MASSES = {name: {"mass": MASS, **keys} for name, keys in MOTIONS.items()}
# With a linear law, masses on rails without a schedule are driven.
CHOICES = {**_MASSES, "rail": {**_MASSES["rail"], "schedule": Key(SCHEDULE.kind, None)}}


def read_masses(values: Any, path: str, scheduled: bool) -> list[PointMass]:
    """The masses, those on rails with the motion that their schedules prescribe.

    Unless they must be ``scheduled``, those without a schedule are driven.
    """
    choices = _MASSES if scheduled else CHOICES
    return read_list(values, path, lambda item, path: _read_mass(*read_one_of(item, path, choices)), empty=True)


def _read_mass(kind: str, table: dict[str, Any]) -> PointMass:
    driven = kind == "rail" and table["schedule"] is None
    return PointMass(table["mass"], Driven(table["rail"]) if driven else read_motion(kind, table))


def read_motion(kind: str, table: dict[str, Any]) -> AbstractMotion:
    """A prescribed motion, from the key that determines its kind and the values of its keys."""
    if kind == "rail":
        return OnRail(table["rail"], table["schedule"])
    return Fixed(table["position"]) if kind == "position" else table["free"]


def write_masses(system: System, targets: Mapping[str, AbstractSchedule | None], path: str) -> list[dict[str, Any]]:
    """The tables of the masses; ``targets`` has the schedules that a law follows, by the path of the mass."""
    return [
        {
            "mass": MASS.kind.write(item.mass, path),
            **write_motion(item.motion, f"{path}[{index}]", targets.get(f"{path}[{index}]")),
        }
        for index, item in enumerate(system.point_masses)
    ]


def write_motion(motion: AbstractMotion, path: str, target: AbstractSchedule | None = None) -> dict[str, Any]:
    """The keys of a motion; a driven mass has the ``target`` of its law as its schedule, if there is one."""
    if isinstance(motion, Fixed):
        return {"position": POSITION.kind.write(motion.position, path)}
    if isinstance(motion, Oscillating):
        return {"free": FREE.kind.write(motion, join(path, "free"))}
    if isinstance(motion, OnRail | Driven):
        schedule = motion.schedule if isinstance(motion, OnRail) else target
        rail = {"rail": RAIL.kind.write(motion.rail, join(path, "rail"))}
        if schedule is None:
            return rail
        return {**rail, "schedule": SCHEDULE.kind.write(schedule, join(path, "schedule"))}
    raise ScenarioError(
        f"Key `{path}` must be on a rail, at a position or oscillating to be written to a file, but its "
        f"motion is a {type(motion).__name__}; keep a scenario that has Python functions as a Python script."
    )
