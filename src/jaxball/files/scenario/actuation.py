"""What moves masses on rails, joints and the angles of a plate, in a scenario file: their schedules, or a law."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

from ...interface.wording import all_of, number_of
from ...physics.body import System
from ...physics.dynamics.parameters import PointMass
from ...physics.feedback import AbstractLaw, FollowSchedules, LinearLaw, Servo
from ...physics.prescribed.motion import Driven
from ...physics.prescribed.schedules import AbstractSchedule
from ...physics.prescribed.signals import AbstractSignal
from .errors import ScenarioError, describe, each_of, key_error
from .mechanisms import JointInState, ReadMechanism, joints_in_state
from .motions import SIGNALS, read_signal, write_signal
from .own import module_of
from .table import Family, Key, Module, join, keys_of, read_family
from .values import Indices, Nested, Numbers

_SIGNALS_WORDS = "a list of numbers, and tables of signals or schedules"


def _read_signals(values: Any, path: str) -> tuple[AbstractSignal | AbstractSchedule, ...]:
    if not isinstance(values, list) or not values:
        raise key_error(path, _SIGNALS_WORDS, describe(values))
    readers = (functools.partial(read_signal, value, f"{path}[{index}]") for index, value in enumerate(values))
    return tuple(each_of(*readers))


def _write_signals(signals: Sequence[AbstractSignal | AbstractSchedule], path: str) -> list[Any] | None:
    return [write_signal(signal, f"{path}[{index}]") for index, signal in enumerate(signals)] or None


FACTORS = module_of(LinearLaw).keys
LINEAR = {
    **FACTORS,
    "signals": Key(
        Nested(_read_signals, _write_signals, _SIGNALS_WORDS, keys_of(SIGNALS), forms=("list",), others=(Numbers(),)),
        None,
    ),
}


def check_factors(values: Any, path: str, names: Sequence[str], joints: Sequence[JointInState], kind: str) -> None:
    """Raises unless each factor has a row for each of ``names``, which the law drives, and columns for the state."""
    for joint in joints:
        if joint.accelerated and joint.target is not None:
            raise ScenarioError(
                f'Key `{joint.schedule}` must be left out where `{path}.form` is "linear", which follows no '
                "schedule; give `initial.theta`, and the motion as `signals`."
            )
    present = [name for name in LINEAR if name in values]
    if not present:
        raise ScenarioError(f"Key `{path}` must have one or more of the keys {', '.join(LINEAR)}, but it has none.")
    free = [joint for joint in joints if not joint.accelerated]
    coordinates = len(names) + len(free)
    columns = {"theta": coordinates, "thetadot": coordinates, "z": 1 if kind == "disk" else 2}
    each = f"each of {all_of(names)}"
    for name in present:
        rows = values[name]
        if name == "signals":
            if len(rows) != len(names):
                raise key_error(join(path, name), f"a list of {len(names)}, one for {each}", f"one of {len(rows)}")
        elif (len(rows), len(rows[0])) != (len(names), columns.get(name, 3)):
            must = f"{len(names)} by {columns.get(name, 3)} numbers, a row for {each}"
            raise key_error(join(path, name), must, f"{len(rows)} by {len(rows[0])}")


Targets = tuple[AbstractSchedule | None, ...]


_WHICH = Key(
    Indices(empty=True),
    None,
    says="the masses that are driven in this way; all on rails if not given, and [] for none, where joints are "
    "accelerated",
)
_GAINS = module_of(Servo).keys
# Each makes the masses that a law drives (None for all on rails), and the law for given schedules.
FORMS: Family = {
    "prescribed": Module(type(None), {}, build=lambda: (None, None)),
    "integrated": Module(FollowSchedules, {"masses": _WHICH}, build=lambda masses=None: (masses, FollowSchedules)),
    "servo": Module(
        Servo,
        {**_GAINS, "masses": _WHICH},
        build=lambda masses=None, **gains: (masses, lambda targets: Servo(targets, **gains)),
    ),
    "linear": Module(LinearLaw, LINEAR, build=lambda **factors: (None, lambda targets: LinearLaw(**factors))),
}


class Actuated(NamedTuple):
    """Masses of which some are driven, the law that drives them, and what the coordinates of the state follow.

    ``targets`` has the schedule of each coordinate, in the order of a state's, or None where it has none.
    """

    masses: list[PointMass]
    law: AbstractLaw | None
    targets: Targets


def is_linear(values: Any) -> bool:
    """Returns whether the table [actuation] asks for a linear law, under which masses on rails may have no schedule."""
    return isinstance(values, dict) and values.get("form") == "linear"


def apply_actuation(
    values: Any,
    path: str,
    masses: Sequence[PointMass],
    mechanisms: Sequence[ReadMechanism],
    angles: Sequence[JointInState],
    kind: str,
) -> Actuated:
    """Makes the masses that a law drives driven, and returns all masses, the law, and the schedules to follow;
    ``angles`` are of the ground.
    """
    chosen, make_law = read_family(values, path, FORMS, key="form")
    joints = [*joints_in_state(mechanisms), *angles]
    accelerated = [joint for joint in joints if joint.accelerated]
    if make_law is None:
        if accelerated:
            names = ", ".join(f'"{form}"' for form in FORMS if form != "prescribed")
            must = f"one of {names}, because a law accelerates {all_of([joint.path for joint in accelerated])}"
            raise key_error(join(path, "form"), must, '"prescribed"')
        return Actuated(list(masses), None, tuple(None for _ in joints))
    linear = values["form"] == "linear"
    driven = _find_driven_masses(chosen, values["form"], path, masses, bool(accelerated))
    names = [*(f"masses[{index}]" for index in driven), *(joint.path for joint in accelerated)]
    check = check_factors if linear else _check_targets
    check(values, path, names, joints=joints, kind=kind)
    changed, schedules = list(masses), [None if linear else masses[index].schedule for index in driven]
    # Their schedules become those that the law follows, and θ becomes part of the state.
    for index in driven:
        changed[index] = masses[index].follow_law()
    followed = (*schedules, *(joint.target for joint in accelerated))
    law = make_law(tuple(schedule for schedule in followed if schedule is not None))
    return Actuated(changed, law, (*schedules, *(joint.target for joint in joints)))


def _find_driven_masses(
    chosen: tuple[int, ...] | None, form: str, path: str, masses: Sequence[PointMass], others: bool
) -> list[int]:
    """Finds the masses that the law drives; ``others`` says whether it drives joints as well."""
    if form == "linear":
        driven = [index for index, item in enumerate(masses) if isinstance(item.motion, Driven)]
        if not driven and not others:
            raise key_error(
                join(path, "form"), '"prescribed" where something else moves every mass and joint', '"linear"'
            )
        return driven
    on_rails = [index for index, item in enumerate(masses) if item.schedule is not None]
    if not on_rails and not others:
        raise key_error(join(path, "form"), '"prescribed" where no mass is on a rail', f'"{form}"')
    driven = on_rails if chosen is None else list(chosen)
    if not set(driven) <= set(on_rails):
        raise key_error(join(path, "masses"), f"masses on rails, which are {on_rails}", str(driven))
    if not driven and not others:
        raise key_error(join(path, "masses"), Indices().words, "[]")
    return driven


def _check_targets(values: Any, path: str, names: Sequence[str], joints: Sequence[JointInState], kind: str) -> None:
    """Raises unless everything that a servo drives, or that is integrated, has a schedule, and gains."""
    for joint in joints:
        if joint.accelerated and joint.target is None:
            must = f'a table where `{path}.form` is "{values["form"]}", which follows it'
            raise ScenarioError(f"Key `{joint.schedule}` must be {must}, but it is missing.")
    if values["form"] != "servo":
        return
    for name in ("stiffness", "damping"):
        if len(values[name]) != len(names):
            each = "one for each driven mass" if not joints else f"one for each of {all_of(names)}"
            raise key_error(
                join(path, name), f"a list of {number_of(len(names), 'number')}, {each}", f"one of {len(values[name])}"
            )


def targets_of(system: System) -> dict[str, AbstractSchedule | None]:
    """Returns the schedules that the law of a system follows, by the paths of the coordinates that it drives.

    **Raises:** :class:`ScenarioError` for a law that a file cannot hold.
    """
    law, driven = system.law, [system.coordinates[slot] for slot in system.accelerated]
    if law is None or type(law) is LinearLaw:
        return dict.fromkeys(driven)
    if type(law) is FollowSchedules:
        return dict(zip(driven, law.schedules, strict=True))
    if type(law) is Servo:
        return dict(zip(driven, law.targets, strict=True))
    raise ScenarioError(
        "Key `actuation` must be a FollowSchedules, a Servo or a LinearLaw to be written to a file, but the law is a "
        f"{type(law).__name__}; keep a scenario that has Python functions as a Python script."
    )


def write_actuation(system: System) -> dict[str, Any]:
    """Returns the table [actuation], empty where every motion is prescribed."""
    law = system.law
    if law is None:
        return {}
    form = {FollowSchedules: "integrated", Servo: "servo", LinearLaw: "linear"}[type(law)]
    if isinstance(law, LinearLaw):
        return {"form": form, **FORMS[form].write(law, "actuation")}
    table: dict[str, Any] = {"form": form}
    if isinstance(law, Servo):
        table |= {name: key.kind.write(getattr(law, name), name) for name, key in _GAINS.items()}
    # All masses on rails is the default.
    if system.driven != system.on_rails:
        table["masses"] = list(system.driven)
    return table
