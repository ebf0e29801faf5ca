"""How far schedules come from 0, and free motions from the centre, between two times: bounds for many at once."""

import functools
from typing import Any

import numpy as np
from jaxtyping import Float

from ...physics.schedules import AbstractSchedule, ConstantRate, Pulse, Sinusoids

LARGEST_PHASE = 1e6  # to which ``sine_cosine`` is good
Stacked = Float[np.ndarray, "_ _"]  # rows and masses, or 1 in the place of either


@functools.singledispatch
def furthest(schedule: AbstractSchedule, start: Stacked, end: Stacked) -> Stacked | None:
    """A bound on |θ(t)| between ``start`` and ``end``; None for a kind of which none is known."""
    return None


@furthest.register
def _(schedule: ConstantRate, start: Stacked, end: Stacked) -> Stacked:
    return np.maximum(*(np.abs(schedule.theta + schedule.rate * t) for t in (start, end)))


@furthest.register
def _(schedule: Sinusoids, start: Stacked, end: Stacked) -> Stacked:
    line = [np.abs(schedule.series.constant + schedule.rate * t) for t in (start, end)]
    return np.maximum(*line) + np.sum(np.abs(schedule.series.amplitude), axis=-1) + _wild(schedule.series, start, end)


@furthest.register
def _(schedule: Pulse, start: Stacked, end: Stacked) -> Stacked:
    """θ̇ is between ``rate`` and what it is after the push."""
    after = schedule.rate + schedule.height * (schedule.hold + schedule.end - 2 * schedule.start) / 2
    fastest = np.maximum(np.abs(schedule.rate), np.abs(after))
    return np.abs(schedule.theta) + fastest * np.maximum(*(np.abs(t - schedule.start) for t in (start, end)))


def reach_of_series(series: Any, start: Stacked, end: Stacked) -> tuple[Stacked, Stacked]:
    """Bounds on the distance of a constant plus sinusoids from the centre, and from the plane of E1 and E3."""
    size = np.abs(series.constant) + np.sum(np.abs(series.amplitude), axis=-2)
    size = size + _wild(series, start, end)[..., None]
    return np.sqrt(np.sum(np.square(size), axis=-1)), size[..., 1]


def largest_phase(series: Any, t: np.ndarray) -> np.ndarray:
    """The largest |frequency_k t + phase_k| of stacked series."""
    phases = np.abs(series.frequency * t[..., None]) + np.abs(series.phase)
    return np.max(phases, axis=-1, initial=0.0)


def _wild(series: Any, start: Stacked, end: Stacked) -> Stacked:
    """Infinite where an angle is so large that its sine as computed is not known to be one, and 0 elsewhere."""
    large = [largest_phase(series, t) > LARGEST_PHASE for t in (start, end)]
    return np.where(large[0] | large[1], np.inf, 0.0)
