"""The search for the step that ends where a guard falls to zero, of guards whose values are known at all times."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.pieces import Span
from jaxball.simulation.mode_ends import RootBracket, bracket_zero, look_at

DENSE = np.linspace(0.0, 1.0, 20_001)[1:]
CLOSE = 1e-9  # of the time: ten times what the search allows, relative to the step
RUN = (jnp.asarray(0.0), jnp.asarray(1.0))


class Search(NamedTuple):
    """Where it ended, after how many steps, and whether it took that for a zero."""

    end: float
    steps: int
    is_zero: bool


@partial(jax.jit, static_argnums=0)
def look_and_bracket(guard, numbers, bracket, end):
    """What follows a step from 0, of which the interpolation is as exact as the steps."""
    start = jnp.asarray(0.0)

    def guards(times):
        return guard(times, *numbers)[:, None]

    look = look_at(guards, lambda asked: guards, Span(start, end, RUN), bracket, jnp.asarray(jnp.inf), 1)
    return bracket_zero(bracket, start, end, look)


def searched(guard, numbers, length):
    """The steps from 0 that a solve would take, the first of this length."""
    bracket, end, steps = RootBracket.none(jnp.asarray(0.0)), length, 0
    while True:
        at_target = bool(bracket.on) and end == float(bracket.target)
        rejected, bracket = look_and_bracket(guard, numbers, bracket, jnp.asarray(end))
        steps += 1
        if not rejected:
            return Search(end, steps, at_target)
        end = float(bracket.target)


def rises_first(t, zero, wavy):
    return t * (zero - t) * (1 + wavy * jnp.sin(25 * t))


@pytest.mark.parametrize("wavy", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("zero", [1e-1, 1e-3, 1e-5, 1e-7])
def test_a_zero_much_closer_than_the_end_of_a_step(zero, wavy):
    """As of a body that has just left the ground, and comes down in a small part of the step that is tried."""
    found = searched(rises_first, (zero, wavy), 0.15)
    assert found.is_zero
    assert found.end == pytest.approx(zero, rel=CLOSE)
    assert found.steps <= 4  # the step that holds it, the one that meets it, and two at most for its last digits


def dips(t, place, depth):
    return (t - place) ** 2 - depth


@pytest.mark.parametrize("depth", [1e-2, 1e-6, 1e-10])
@pytest.mark.parametrize("place", [0.201, 0.5, 0.83])
def test_a_dip_is_seen_however_narrow(place, depth):
    """Positive but for 2e-5 of the step around a place, in the last case."""
    found = searched(dips, (place, depth), 1.0)
    assert found.is_zero
    # Where the guard falls by 2 √depth in the unit of time, its rounding moves the zero by this.
    assert found.end == pytest.approx(place - np.sqrt(depth), abs=1e-10 + 1e-16 / np.sqrt(depth))


def touches(t, place):
    return (t - place) ** 2 + 1e-12


def test_a_guard_that_stays_positive_ends_nothing():
    assert searched(touches, (0.437,), 1.0) == Search(1.0, 1, False)


def test_a_guard_below_zero_by_rounding_may_rise():
    """As after a reset, where a body that has just left the ground is in it by rounding."""
    assert searched(lambda t, low: t - low, (1e-15,), 1.0) == Search(1.0, 1, False)


@pytest.mark.parametrize("power", [2, 3])
def test_a_guard_may_rise_slowly_at_first(power):
    """As the speed of a slip that begins where friction has just given way."""
    assert searched(lambda t, low: t**power - low, (1e-13,), 1.0) == Search(1.0, 1, False)


def test_a_guard_that_falls_from_zero_ends_its_mode_at_once():
    found = searched(lambda t, slope: -slope * t, (1.0,), 1.0)
    assert found.is_zero
    assert found.end < 1e-14


def wave(t, size, frequency, phase, polynomial, least):
    """A smooth function that varies a few times in a step, raised so that it begins at ``least`` or more."""

    def value(t):
        waves = sum(size[k] * jnp.sin(frequency[k] * t + phase[k]) for k in range(3))
        return waves + polynomial[0] + polynomial[1] * t + polynomial[2] * t**2

    return value(t) + jnp.maximum(0.0, -value(jnp.asarray(0.0))) + least


def rising_wave(t, *numbers):
    return t * wave(t, *numbers)


def first_zero(guard, numbers):
    """None where there is none that the dense times show."""
    guard = jax.jit(guard)
    below = np.flatnonzero(np.asarray(guard(jnp.asarray(DENSE), *numbers)) <= 0)
    if not below.size or not below[0]:
        return None
    low, high = DENSE[below[0] - 1], DENSE[below[0]]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if guard(jnp.asarray(middle), *numbers) > 0 else (low, middle)
    return high


@pytest.mark.thorough
@pytest.mark.parametrize(("guard", "least"), [(wave, 0.1), (rising_wave, 0.05)])
def test_no_step_ends_behind_a_zero(guard, least):
    """Of 200 random guards, all zeros are met, also those of dips."""
    random, steps = np.random.default_rng(3), []
    for _ in range(200):
        numbers = random.normal(size=3), random.uniform(1, 12, 3), random.uniform(0, 6, 3), random.normal(size=3)
        numbers = (*map(jnp.asarray, numbers), jnp.asarray(least))
        zero, found = first_zero(guard, numbers), searched(guard, numbers, 1.0)
        if zero is None:
            assert found == Search(1.0, 1, False)
        else:
            assert found.is_zero
            assert found.end == pytest.approx(zero, rel=CLOSE)
            steps.append(found.steps)
    assert len(steps) > 50
    assert np.mean(steps) < 4
