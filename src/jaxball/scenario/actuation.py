"""Who moves the masses on rails, in a scenario file: their schedules, or a law."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ..interface.wording import counted
from ..physics.body import PointMass, System
from ..physics.feedback import AbstractLaw, FollowSchedules, Servo
from ..physics.motion import Driven, OnRail
from ..physics.schedules import AbstractSchedule
from .table import Family, Key, Module, join, read_family
from .values import NOT_NEGATIVE, Indices, Numbers, ScenarioError, key_error


class Actuation(NamedTuple):
    """The masses that a law drives (None for all on rails), and the law for given schedules."""

    masses: tuple[int, ...] | None
    law: Callable[[tuple[AbstractSchedule, ...]], AbstractLaw] | None


def _prescribed() -> Actuation:
    return Actuation(None, None)


def _integrated(masses=None) -> Actuation:
    return Actuation(masses, FollowSchedules)


def _servo(stiffness, damping, masses=None) -> Actuation:
    return Actuation(masses, lambda targets: Servo(targets, stiffness, damping))


_WHICH = Key(Indices(), None)
_GAINS = Key(Numbers((None,), NOT_NEGATIVE))
FORMS: Family = {
    "prescribed": Module(type(None), {}, build=_prescribed),
    "integrated": Module(FollowSchedules, {"masses": _WHICH}, build=_integrated),
    "servo": Module(Servo, {"stiffness": _GAINS, "damping": _GAINS, "masses": _WHICH}, build=_servo),
}


def apply_actuation(
    values: Any, path: str, masses: Sequence[PointMass]
) -> tuple[list[PointMass], AbstractLaw | None, tuple[AbstractSchedule, ...]]:
    """The masses with those that a law drives made so, the law, and the schedules that it follows."""
    chosen, make_law = read_family(values, path, FORMS, key="form")
    if make_law is None:
        return list(masses), None, ()
    driven = _driven(chosen, values["form"], path, masses)
    for name in ("stiffness", "damping"):
        if name in values and len(values[name]) != len(driven):
            raise key_error(
                join(path, name),
                f"a list of {counted(len(driven), 'number')}, one for each driven mass",
                f"one of {len(values[name])}",
            )
    schedules, changed = [], list(masses)
    for index in driven:
        motion = masses[index].motion
        assert isinstance(motion, OnRail)
        schedules.append(motion.schedule)
        changed[index] = PointMass(masses[index].mass, Driven(motion.rail))
    return changed, make_law(tuple(schedules)), tuple(schedules)


def _driven(chosen: tuple[int, ...] | None, form: str, path: str, masses: Sequence[PointMass]) -> list[int]:
    on_rails = [index for index, item in enumerate(masses) if isinstance(item.motion, OnRail)]
    if not on_rails:
        raise key_error(join(path, "form"), '"prescribed" where no mass is on a rail', f'"{form}"')
    driven = on_rails if chosen is None else list(chosen)
    if not set(driven) <= set(on_rails):
        raise key_error(join(path, "masses"), f"masses on rails, which are {on_rails}", str(driven))
    return driven


def targets_of(law: AbstractLaw | None) -> tuple[AbstractSchedule, ...]:
    """The schedules that a law follows, one for each driven mass.

    **Raises:** :class:`ScenarioError` for a law that a file cannot hold.
    """
    if law is None:
        return ()
    if type(law) is FollowSchedules:
        return law.schedules
    if type(law) is Servo:
        return law.targets
    raise ScenarioError(
        "Key `actuation` must be a FollowSchedules or a Servo to be written to a file, but the law is a "
        f"{type(law).__name__}; keep a scenario that has Python functions as a Python script."
    )


def write_actuation(system: System) -> dict[str, Any]:
    """The table [actuation], empty where every motion is prescribed."""
    law = system.law
    if law is None:
        return {}
    on_rails = [i for i, item in enumerate(system.point_masses) if isinstance(item.motion, OnRail | Driven)]
    table: dict[str, Any] = {"form": "servo" if isinstance(law, Servo) else "integrated"}
    if isinstance(law, Servo):
        table |= {name: _GAINS.kind.write(getattr(law, name), name) for name in ("stiffness", "damping")}
    if list(system.driven) != on_rails:
        table["masses"] = list(system.driven)
    return table
