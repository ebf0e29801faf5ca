"""What begins to roll or to slip at once, from rest or almost, goes the way that it is pulled."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Ball, BallState, Contact, Ground, Resistance, simulate
from jaxball.physics import ReleasedState

pytestmark = pytest.mark.thorough

INERTIA, TIMES, EXACT = (0.4, 0.4, 0.4), (0.0, 2.0), {"rtol": 1e-12, "atol": 1e-12}
SLOPE = Ball(mass=1.0, inertia=INERTIA, ground=Ground(0.1), resistance=Resistance(dry=0.05, exact=True))
ICE = Ball(mass=1.0, inertia=INERTIA, ground=Ground(0.5))


def rolled(v):
    """The way of a ball that dry resistance cannot hold, whose centre has the velocity ``v``."""
    start = BallState(Omega=jnp.stack([-v[1], v[0], 0.0 * v[0]]))
    return simulate(SLOPE, TIMES, start, **EXACT).state.z[-1]


def slid(v):
    """The way of a ball that friction cannot hold, which does not turn."""
    start = ReleasedState(BallState(), V=jnp.append(v, 0.0))
    return simulate(ICE, TIMES, start, contact=Contact(0.05), **EXACT).state.z[-1]


@pytest.mark.parametrize("way", [rolled, slid])
def test_a_slow_start_in_any_direction_changes_little(way):
    """By no more than the start takes it in the time, where Newton's method had found a direction that is none."""
    at_rest, speed = way(jnp.zeros(2)), 1e-8
    for degrees in (0.0, 90.0, 168.0, 172.0, 175.0, 176.0, 178.0, 179.9, 180.0, -175.0):
        angle = np.radians(degrees)
        moved = way(speed * jnp.asarray([np.cos(angle), np.sin(angle)]))
        assert np.max(np.abs(moved - at_rest)) <= 2.1 * speed, degrees


@pytest.mark.parametrize(("way", "across", "tolerance"), [(rolled, 0.0, 1e-12), (slid, 1 / 0.7, 1e-9)])
def test_derivatives_at_rest_are_those_of_a_start_that_goes_on(way, across, tolerance):
    """Along the way it goes on with what it has, 2 in the time of 2. Across it, what turns it aside is gone at once:
    nothing of a roll, and of a slip what friction has made roll, 1 / (1 + 0.4) of V, that is 2 · 5/7 of it.
    """
    derivative = jax.jacrev(way)(jnp.zeros(2))
    np.testing.assert_allclose(derivative, [[2.0, 0.0], [0.0, across]], rtol=0, atol=tolerance)
