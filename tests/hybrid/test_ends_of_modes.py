"""The search for the step that ends where a guard falls to zero, of guards whose values are known at all times."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.simulation import mode_ends
from jaxball.simulation.mode_ends import RootBracket
from jaxball.solvers.dense.steps import sampling

bracketed = jax.jit(mode_ends.bracket_zero)
DENSE = np.linspace(0.0, 1.0, 20_001)[1:]
CLOSE = 1e-9  # of the time: ten times what the search allows, relative to the step


class Search(NamedTuple):
    """Where it ended, after how many steps, and whether it took that for a zero."""

    end: float
    steps: int
    is_zero: bool


def searched(guard, length):
    """The steps from 0 that a solve would take, the first of this length."""
    bracket, end, steps = RootBracket.none(jnp.asarray(0.0)), length, 0
    while True:
        at_target = bool(bracket.on) and end == float(bracket.target)
        samples = jnp.asarray(guard(end * sampling().nodes))[None]
        rejected, bracket = bracketed(bracket, jnp.asarray(0.0), jnp.asarray(end), samples)
        steps += 1
        if not rejected:
            return Search(end, steps, at_target)
        end = float(bracket.target)


@pytest.mark.parametrize("wavy", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("zero", [1e-1, 1e-3, 1e-5, 1e-7])
def test_a_zero_much_closer_than_the_end_of_a_step(zero, wavy):
    """As of a body that has just left the ground, and comes down in a small part of the step that is tried."""
    found = searched(lambda t: t * (zero - t) * (1 + wavy * np.sin(25 * t)), 0.15)
    assert found.is_zero
    assert found.end == pytest.approx(zero, rel=CLOSE)
    assert found.steps <= 10


def wave(random):
    """A smooth function that varies a few times in a step."""
    size, frequency, phase = random.normal(size=3), random.uniform(1, 12, 3), random.uniform(0, 6, 3)
    polynomial = random.normal(size=3)

    def value(t):
        waves = size * np.sin(np.multiply.outer(t, frequency) + phase)
        return waves.sum(axis=-1) + np.polynomial.polynomial.polyval(t, polynomial)

    return value


def positive_at_the_start(random):
    value = wave(random)
    return lambda t: value(t) + max(0.0, -value(0.0)) + 0.1


def rising_from_zero(random):
    value = wave(random)
    return lambda t: t * (value(t) + max(0.0, -value(0.0)) + 0.05)


def first_zero(guard):
    """None where there is none that the dense times show."""
    below = np.flatnonzero(guard(DENSE) <= 0)
    if not below.size or not below[0]:
        return None
    low, high = DENSE[below[0] - 1], DENSE[below[0]]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if guard(middle) > 0 else (low, middle)
    return high


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [positive_at_the_start, rising_from_zero])
def test_no_step_ends_behind_a_zero(kind):
    """Except for a dip between two places at which the guard is evaluated, and its quartic as well."""
    random, right, steps = np.random.default_rng(3), 0, []
    for _ in range(200):
        guard = kind(random)
        zero, found = first_zero(guard), searched(guard, 1.0)
        value = guard(found.end)
        if zero is None:
            assert value > 0
        elif value > 1e-6:
            assert np.all(guard(found.end * sampling().nodes)[1:] > 0)  # such a dip
        else:
            assert found.is_zero
            right += found.end == pytest.approx(zero, rel=CLOSE)
            steps.append(found.steps)
    assert right >= len(steps) - 2  # of one behind a dip that was not seen
    assert len(steps) > 50
    assert np.mean(steps) < 8
