"""How far schedules come from 0, and free motions from the centre, between two times: bounds for many at once."""

import functools
from typing import Any

import numpy as np
from jaxtyping import Float

from ...schedules import AbstractSchedule, ConstantRate, Pulse, Sinusoids

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
    return np.maximum(*line) + np.sum(np.abs(schedule.series.amplitude), axis=-1)


@furthest.register
def _(schedule: Pulse, start: Stacked, end: Stacked) -> Stacked:
    """θ̇ is between ``rate`` and what it is after the push."""
    after = schedule.rate + schedule.height * (schedule.hold + schedule.end - 2 * schedule.start) / 2
    fastest = np.maximum(np.abs(schedule.rate), np.abs(after))
    return np.abs(schedule.theta) + fastest * np.maximum(*(np.abs(t - schedule.start) for t in (start, end)))


def reach_of_series(series: Any) -> tuple[Stacked, Stacked]:
    """Bounds on the distance of a constant plus sinusoids from the centre, and from the plane of E1 and E3."""
    size = np.abs(series.constant) + np.sum(np.abs(series.amplitude), axis=-2)
    return np.sqrt(np.sum(np.square(size), axis=-1)), size[..., 1]
