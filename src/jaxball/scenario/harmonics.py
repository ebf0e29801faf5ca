"""Constants plus sinusoids, and powers of the time, in a scenario file: of forces, free motions and schedules."""

from typing import Any

from ..interface.wording import counted
from ..numerics.harmonics import HarmonicSeries
from ..physics.force import HarmonicForce
from ..physics.motion import Oscillating
from ..physics.schedules import Sinusoids
from .table import Key, Module, join
from .values import ANGLE, RATE, Numbers, key_error

WAVES = {
    "amplitude": Key(Numbers((None,)), ()),
    "frequency": Key(Numbers((None,), dimension=RATE), ()),
    "phase": Key(Numbers((None,), dimension=ANGLE), ()),
}
WAVES_IN_SPACE = {**WAVES, "amplitude": Key(Numbers((None, 3)), ())}
POWERS = {"powers": Key(Numbers((None, 3)), None)}
SERIES = {name: f"series.{name}" for name in ("constant", *WAVES)}
PATH = {name: f"path.{name}" for name in ("constant", *WAVES, "powers")}


def check_lengths(table: dict[str, Any], path: str) -> None:
    """Raises unless there is one amplitude for each frequency, and one phase if any."""
    n = len(table["frequency"])
    for name in ("amplitude", "phase"):
        if len(table[name]) != n and not (name == "phase" and len(table[name]) == 0):
            raise key_error(
                join(path, name),
                f"as long as `frequency`, which has {counted(n, 'entry', 'entries')}",
                f"one of {len(table[name])}",
            )


def series_of(constant, amplitude, frequency, phase, powers=None) -> HarmonicSeries:
    """A series of which a file may leave out the phases, every sinusoid, or the powers."""
    still = len(frequency) == 0
    return HarmonicSeries(constant, None if still else amplitude, frequency, None if len(phase) == 0 else phase, powers)


def _force(**keys: Any) -> HarmonicForce:
    series = series_of(**keys)
    return HarmonicForce(series.constant, series.amplitude, series.frequency, series.phase, series.powers)


def _oscillating(**keys: Any) -> Oscillating:
    return Oscillating(series_of(**keys))


def _sinusoids(theta, rate, **waves: Any) -> Sinusoids:
    series = series_of(theta, **waves)
    return Sinusoids(theta, series.amplitude, series.frequency, series.phase, rate)


FORCE = Module(
    HarmonicForce,
    {"constant": Key(Numbers((3,)), (0.0, 0.0, 0.0)), **WAVES_IN_SPACE, **POWERS},
    build=_force,
    attributes={**SERIES, "powers": "series.powers"},
    check=check_lengths,
)
OSCILLATING = Module(
    Oscillating,
    {"constant": Key(Numbers((3,))), **WAVES_IN_SPACE, **POWERS},
    build=_oscillating,
    attributes=PATH,
    check=check_lengths,
)
SINUSOIDS = Module(
    Sinusoids,
    {"theta": Key(Numbers(dimension=ANGLE)), "rate": Key(Numbers(dimension=RATE), 0.0), **WAVES},
    build=_sinusoids,
    attributes={**SERIES, "theta": "series.constant"},
    check=check_lengths,
)
