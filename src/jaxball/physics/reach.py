"""Bounds on how far masses get from the centre and out of a disk's plane, cheaper than checking every time."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..numerics.functions import HarmonicSeries
from .confinement import is_bounded, rounding
from .motion import AbstractMotion, Driven, OnRail, Oscillating
from .parameters import BodyParameters
from .rails import Tube
from .schedules import AbstractSchedule, ConstantRate, Pulse, Sinusoids

LARGEST_PHASE = 1e6  # to which ``sine_cosine`` is good
Time = Float[Array, ""]


class Reach(NamedTuple):
    """No point is further than ``far`` from the centre, or than ``aside`` from the plane of E1 and E3."""

    far: Float[Array, "..."]
    aside: Float[Array, "..."]


def surely_stay(system: BodyParameters, start: Time, end: Time) -> Bool[Array, ""]:
    """Whether bounds prove that masses in free motion or on open rails stay in the body from ``start`` to ``end``.

    Driven masses are not checked.
    """
    stay = jnp.asarray(True)
    for group in system.groups:
        if is_bounded(group.motion) or isinstance(group.motion, Driven):
            continue
        bound = eqx.filter_vmap(lambda motion: reach(motion, start, end))(group.motion)
        stay &= jnp.all(bound.far <= system.radius)
        if system.planar:
            stay &= jnp.all(bound.aside < rounding(system.radius) / 2 * system.radius)
    return stay


@functools.singledispatch
def reach(motion: AbstractMotion, start: Time, end: Time) -> Reach:
    """Bounds on a motion between two times; infinite for a kind of which none are known."""
    return _unknown(start)


def _unknown(t: Time) -> Reach:
    return Reach(jnp.full_like(t, jnp.inf), jnp.full_like(t, jnp.inf))


@reach.register
def _(motion: Oscillating, start: Time, end: Time) -> Reach:
    size = jnp.abs(motion.path.constant) + jnp.sum(jnp.abs(motion.path.amplitude), axis=0)
    size += _beyond_sines(motion.path, start, end)
    if motion.path.powers is not None:
        latest = jnp.maximum(jnp.abs(start), jnp.abs(end))
        size += HarmonicSeries(jnp.zeros_like(size), powers=jnp.abs(motion.path.powers))(latest)
    return Reach(jnp.sqrt(jnp.sum(size**2)), size[1])


@reach.register
def _(motion: OnRail, start: Time, end: Time) -> Reach:
    if not isinstance(motion.rail, Tube):
        return _unknown(start)
    direction = jnp.abs(motion.rail.direction)
    along = largest_angle(motion.schedule, start, end) * direction / jnp.sqrt(jnp.sum(direction**2))
    size = jnp.abs(motion.rail.centre) + along
    return Reach(jnp.sqrt(jnp.sum(size**2)), size[1])


@functools.singledispatch
def largest_angle(schedule: AbstractSchedule, start: Time, end: Time) -> Float[Array, ""]:
    """A bound on |θ(t)| between two times; infinite for a kind of which none is known."""
    return jnp.full_like(start, jnp.inf)


@largest_angle.register
def _(schedule: ConstantRate, start: Time, end: Time) -> Float[Array, ""]:
    return _of_line(schedule.theta, schedule.rate, start, end)


@largest_angle.register
def _(schedule: Sinusoids, start: Time, end: Time) -> Float[Array, ""]:
    waves = jnp.sum(jnp.abs(schedule.series.amplitude)) + _beyond_sines(schedule.series, start, end)
    return _of_line(schedule.series.constant, schedule.rate, start, end) + waves


@largest_angle.register
def _(schedule: Pulse, start: Time, end: Time) -> Float[Array, ""]:
    """θ̇ is between ``rate`` and what it is after the push."""
    after = schedule.rate + schedule.height * (schedule.hold + schedule.end - 2 * schedule.start) / 2
    fastest = jnp.maximum(jnp.abs(schedule.rate), jnp.abs(after))
    furthest = jnp.maximum(jnp.abs(start - schedule.start), jnp.abs(end - schedule.start))
    return jnp.abs(schedule.theta) + fastest * furthest


def _of_line(theta: Float[Array, ""], rate: Float[Array, ""], start: Time, end: Time) -> Float[Array, ""]:
    return jnp.maximum(jnp.abs(theta + rate * start), jnp.abs(theta + rate * end))


def _beyond_sines(series: HarmonicSeries, start: Time, end: Time) -> Float[Array, ""]:
    """Infinite where an angle is so large that its sine as computed is not known to be one, and 0 elsewhere."""
    latest = jnp.maximum(jnp.abs(start), jnp.abs(end))
    phases = jnp.abs(series.frequency) * latest + jnp.abs(series.phase)
    return jnp.where(jnp.max(phases, initial=0.0) > LARGEST_PHASE, jnp.inf, 0.0)
