"""The point masses of a scenario file and their motions: rails, frames, schedules, harmonic series and signals."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...interface.arguments import require_function
from ...interface.wording import number_of
from ...numerics.arrays import a_number
from ...numerics.declare import ANGLE, LENGTH, OF_FORCE, OF_MASS, POSITIVE, RATE, Dimension
from ...numerics.functions import HarmonicSeries
from ...physics.body import System
from ...physics.dynamics.parameters import PointMass
from ...physics.forces.force import HarmonicForce
from ...physics.prescribed.frames import AbstractFrame, MatrixFrame, SphericalFrame, VersorFrame
from ...physics.prescribed.motion import AbstractMotion, Driven, Fixed, OnRail, Oscillating, rail_of, schedule_of
from ...physics.prescribed.rails import (
    AbstractRail,
    BernoulliEight,
    Circle,
    Ellipse,
    FourierRail,
    GeronoEight,
    SplineRail,
    Tube,
)
from ...physics.prescribed.recorded import RecordedSchedule
from ...physics.prescribed.schedules import (
    AbstractSchedule,
    ConstantRate,
    PiecewiseAcceleration,
    Pulse,
    Sinusoids,
    Waypoints,
)
from ...physics.prescribed.signals import AbstractSignal, ConstantSignal, PiecewiseSignal
from .errors import ScenarioError, key_error
from .logs import KIND as LOG
from .own import Open, Parts, module_of, modules_of
from .recorded import SCHEDULE_FROM_LOG, SIGNAL_OR_SCHEDULE_FROM_LOG
from .table import (
    Check,
    Family,
    Key,
    Keys,
    Module,
    as_long_as,
    at_least,
    join,
    keys_of,
    member_of,
    read_family,
    read_list,
    read_one_of,
    write_family,
    write_member,
    write_table,
)
from .values import Nested, Numbers, namespace, require

ORTHONORMAL = 1e-9

_FRAMES: Family = {
    "azimuth": module_of(SphericalFrame),
    "versor": module_of(VersorFrame, attributes={"versor": "q"}),
    "matrix": module_of(MatrixFrame, attributes={"matrix": "B"}, keys={"matrix": Key(Numbers((3, 3)))}),
}
_CHOICES = {name: frame.keys for name, frame in _FRAMES.items()}


def read_frame(values: Any, path: str) -> AbstractFrame:
    """Reads a frame by spherical angles, a versor or a rotation matrix."""
    name, table = read_one_of(values, path, _CHOICES)
    if name == "matrix":
        B = table["matrix"]
        xp = namespace(B)
        # The determinant tells a rotation from a reflection, whose columns are orthonormal, too.
        require(
            xp.allclose(B.T @ B, np.eye(3), rtol=0, atol=ORTHONORMAL) & (xp.linalg.det(B) > 0),
            join(path, "matrix"),
            "a rotation matrix, whose columns are orthonormal and whose determinant is 1",
            lambda: str(B.tolist()),
        )
    return _FRAMES[name].make(table)


def write_frame(frame: AbstractFrame, path: str) -> dict[str, Any] | None:
    """Returns the table of a frame, or None for the identity, which is the default."""
    _, table = write_member(frame, path, _FRAMES)
    # By digits, which tell 0.0 from −0.0: what is read back must be the same.
    return None if repr(table) == repr({"matrix": np.eye(3).tolist()}) else table


FRAME = Key(Nested(read_frame, write_frame, tables=_CHOICES), None)


WAVES = {
    "amplitude": Key(Numbers((None,), dimension=ANGLE, by_size=True), (), says="one for each sinusoid"),
    "frequency": Key(Numbers((None,), dimension=RATE), (), says="one for each sinusoid"),
    "phase": Key(Numbers((None,), dimension=ANGLE), (), says="one for each sinusoid; 0 if not given"),
}


def _waves_in_space(dimension: Dimension) -> Keys:
    """Returns the keys of the sinusoids and of the coefficients of t, t², … of a vector of this dimension; those of t
    have the dimension of its rate.
    """
    amplitude = Key(Numbers((None, 3), dimension=dimension, by_size=True), (), says="a row for each sinusoid")
    rate = dimension._replace(time=dimension.time - 1)
    says = "the coefficients of t, t², …, each in the unit of the one before it over time"
    powers = Key(Numbers((None, 3), dimension=rate, by_size=True), None, says)
    return {**WAVES, "amplitude": amplitude, "powers": powers}


SERIES = {name: f"series.{name}" for name in ("constant", *WAVES)}
PATH = {name: f"path.{name}" for name in ("constant", *WAVES, "powers")}


def check_lengths(table: dict[str, Any], path: str) -> None:
    """Raises unless there is one amplitude for each frequency, and one phase if any."""
    as_long_as("frequency", "amplitude", *(["phase"] if len(table["phase"]) else []))(table, path)


def wave_arguments(amplitude, frequency, phase, **others: Any) -> dict[str, Any]:
    """Returns the arguments of a series of which a file may leave out the phases, or every sinusoid."""
    waves = {"amplitude": amplitude if len(frequency) else None, "phase": phase if len(phase) else None}
    return {**others, **waves, "frequency": frequency}


def waves_of(kind: type, keys: Keys, attributes: Mapping[str, str], build: Callable[..., Any] | None = None) -> Module:
    """Describes what has sinusoids, among other ``keys``; ``build`` makes it of their arguments if not its class."""
    make = build or kind
    return Module(kind, keys, lambda **given: make(**wave_arguments(**given)), attributes, check_lengths)


HARMONIC_FORCE = waves_of(
    HarmonicForce,
    {"constant": Key(Numbers((3,), dimension=OF_FORCE), (0.0, 0.0, 0.0)), **_waves_in_space(OF_FORCE)},
    {**SERIES, "powers": "series.powers"},
)
OSCILLATING = waves_of(
    Oscillating,
    {
        "constant": Key(Numbers((3,), dimension=LENGTH, by_size=True), says="the constant part"),
        **_waves_in_space(LENGTH),
    },
    PATH,
    lambda **series: Oscillating(HarmonicSeries(**series)),
)
SINUSOIDS = waves_of(
    Sinusoids,
    {
        "theta": Key(Numbers(dimension=ANGLE), says="the constant part of θ"),
        "rate": Key(Numbers(dimension=RATE), 0.0),
        **WAVES,
    },
    {**SERIES, "theta": "series.constant"},
)
_PLACED: Parts = {AbstractFrame: FRAME.kind}
_RAILS: Family = {
    **modules_of(
        {
            "circle": Circle,
            "ellipse": Ellipse,
            "gerono-eight": GeronoEight,
            "bernoulli-eight": BernoulliEight,
            "tube": Tube,
        },
        _PLACED,
    ),
    "fourier": module_of(FourierRail, check=as_long_as("cosine", "sine", entry=("row", "rows"))),
    "spline": module_of(
        SplineRail, attributes={"points": "points_on_rail"}, check=at_least("points", 3, "three points")
    ),
}
RAILS = Open(
    AbstractRail, _RAILS, lambda rail: require_function("rail", rail.__call__, (3,), theta=a_number()), _PLACED
)


def _check_pulse(table: dict[str, Any], path: str) -> None:
    for earlier, later, must in (("start", "hold", "not before"), ("hold", "end", "later than")):
        first, second = table[earlier], table[later]
        holds = second > first if later == "end" else second >= first
        require(holds, join(path, later), f"{must} `{earlier}` = {first!r}", lambda second=second: repr(second))


def row_for_each_interval(name: str, entry: str = "row") -> Check:
    """Returns the check that the list ``name`` of a table has an ``entry`` for each interval between its ``times``."""

    def check(table: dict[str, Any], path: str) -> None:
        times, rows = len(table["times"]), len(table[name])
        if times != rows + 1:
            must = f"a list with a {entry} for each interval between the {times} `times`"
            raise key_error(join(path, name), must, f"one of {number_of(rows, entry)}")

    return check


def _check_waypoints(table: dict[str, Any], path: str) -> None:
    at_least("times", 2, "two times")(table, path)
    as_long_as("times", "theta")(table, path)


_SCHEDULES: Family = {
    "pulse": module_of(Pulse, check=_check_pulse),
    "constant-rate": module_of(ConstantRate),
    "sinusoids": SINUSOIDS,
    "piecewise-acceleration": module_of(PiecewiseAcceleration, check=row_for_each_interval("accelerations")),
    "waypoints": module_of(Waypoints, check=_check_waypoints),
    LOG: SCHEDULE_FROM_LOG,
}
SCHEDULES = Open(
    AbstractSchedule, _SCHEDULES, lambda schedule: require_function("schedule", schedule.__call__, (), t=a_number())
)
SCHEDULE = Key(member_of(SCHEDULES))


@dataclass(frozen=True)
class _Constant(Numbers):
    """A number, where a table might be as well."""

    @property
    def words(self) -> str:
        return "a finite number, or the table of a signal or a schedule"


# A signal's value has the dimension of the quantity that it drives, for which an angle stands here;
# `dimension_of` replaces it.
_NUMBER = _Constant(dimension=ANGLE, by_size=True)
_PIECES = module_of(PiecewiseSignal, check=row_for_each_interval("values"))
_STEPS = Module(
    PiecewiseSignal,
    {**_PIECES.keys, "values": Key(Numbers((None,), dimension=ANGLE, by_size=True), says="one for each interval")},
    check=row_for_each_interval("values", "number"),
)
SIGNALS: Family = {"steps": _STEPS, "piecewise": _PIECES, **SCHEDULES, LOG: SIGNAL_OR_SCHEDULE_FROM_LOG}
# Without "steps", whose class is that of "piecewise"; `write_signal` chooses between them.
_WRITTEN: Family = {"piecewise": _PIECES, **SCHEDULES, LOG: SIGNAL_OR_SCHEDULE_FROM_LOG}


def read_signal(value: Any, path: str) -> AbstractSignal | AbstractSchedule:
    """Reads a signal, or a schedule whose value it is."""
    return read_family(value, path, SIGNALS) if isinstance(value, dict) else ConstantSignal(_NUMBER.read(value, path))


def write_signal(signal: AbstractSignal | AbstractSchedule, path: str) -> Any:
    """Returns the number or the table of a signal."""
    if isinstance(signal, ConstantSignal):
        return _NUMBER.write(signal.value, path)
    if isinstance(signal, PiecewiseSignal) and signal.values.shape[1] == 1:
        steps = {"times": signal.times, "values": np.ravel(signal.values)}
        return {"kind": "steps", **write_table(steps, path, _STEPS.keys)}
    if isinstance(signal, RecordedSchedule):
        return {"kind": LOG, **SIGNAL_OR_SCHEDULE_FROM_LOG.write(signal, path)}
    return write_family(signal, path, _WRITTEN)


SIGNAL = Nested(read_signal, write_signal, _NUMBER.words, keys_of(SIGNALS), others=(_NUMBER,))


MASS = Key(Numbers(rule=POSITIVE, dimension=OF_MASS), says="the mass")
RAIL = Key(member_of(RAILS), says="the curve along which it moves")
POSITION = Key(Numbers((3,), dimension=LENGTH), says="where it stays")
FREE = Key(OSCILLATING.nested, says="its motion without a rail")

MOTIONS = {
    "rail": {"rail": RAIL, "schedule": replace(SCHEDULE, says="θ(t), its motion along the curve")},
    "position": {"position": POSITION},
    "free": {"free": FREE},
}
_SCHEDULED_MASSES = {name: {"mass": MASS, **keys} for name, keys in MOTIONS.items()}
# With a linear law, masses on rails without a schedule are driven.
_MAY_BE_DRIVEN = Key(SCHEDULE.kind, None, "θ(t), its motion along the curve; if not given, a linear law drives it")
MASSES = {**_SCHEDULED_MASSES, "rail": {**_SCHEDULED_MASSES["rail"], "schedule": _MAY_BE_DRIVEN}}


def read_masses(values: Any, path: str, scheduled: bool) -> list[PointMass]:
    """Reads the masses, those on rails with the motion that their schedules prescribe.

    Unless they must be ``scheduled``, those without a schedule are driven.
    """
    choices = _SCHEDULED_MASSES if scheduled else MASSES
    return read_list(values, path, lambda item, path: _read_mass(*read_one_of(item, path, choices)), empty=True)


def _read_mass(kind: str, table: dict[str, Any]) -> PointMass:
    driven = kind == "rail" and table["schedule"] is None
    return PointMass(table["mass"], Driven(table["rail"]) if driven else read_motion(kind, table))


def read_motion(kind: str, table: dict[str, Any]) -> AbstractMotion:
    """Makes a prescribed motion, from the key that determines its kind and the values of its keys."""
    if kind == "rail":
        return OnRail(table["rail"], table["schedule"])
    return Fixed(table["position"]) if kind == "position" else table["free"]


def write_masses(system: System, targets: Mapping[str, AbstractSchedule | None], path: str) -> list[dict[str, Any]]:
    """Returns the tables of the masses; ``targets`` has the schedules that a law follows, by the path of the mass."""
    return [
        {
            "mass": MASS.kind.write(item.mass, path),
            **write_motion(item.motion, f"{path}[{index}]", targets.get(f"{path}[{index}]")),
        }
        for index, item in enumerate(system.point_masses)
    ]


def write_motion(motion: AbstractMotion, path: str, target: AbstractSchedule | None = None) -> dict[str, Any]:
    """Returns the keys of a motion; a driven mass has the ``target`` of its law as its schedule, if there is one."""
    if isinstance(motion, Fixed):
        return {"position": POSITION.kind.write(motion.position, path)}
    if isinstance(motion, Oscillating):
        return {"free": FREE.kind.write(motion, join(path, "free"))}
    if (rail := rail_of(motion)) is not None:
        schedule = target if isinstance(motion, Driven) else schedule_of(motion)
        rail = {"rail": RAIL.kind.write(rail, join(path, "rail"))}
        if schedule is None:
            return rail
        return {**rail, "schedule": SCHEDULE.kind.write(schedule, join(path, "schedule"))}
    raise ScenarioError(
        f"Key `{path}` must be on a rail, at a position or oscillating to be written to a file, but its "
        f"motion is a {type(motion).__name__}; keep a scenario that has Python functions as a Python script."
    )
