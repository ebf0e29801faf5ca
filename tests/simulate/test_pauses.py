"""States of runs in which a ball stops slipping or rolling within a short time that no step of the solve covers."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Ball, BallState, Contact, Resistance, simulate
from jaxball.physics import ReleasedState

G, MU = 9.81, 0.2
SOLID = Ball(mass=1.0, radius=1.0, inertia=(0.4, 0.4, 0.4), gravity=G)
TOLERANCE = 1e-8
AT_ONCE = 1e-12  # of a pause that the tolerance lets be longer than this


def times_around(run):
    """Times before, in and after the pause that ends at the only switch of a run, the second step after it included."""
    dense, end = run.interpolant.solution.interpolation, float(run.history.switches.times[0])
    ends = np.asarray(dense.ts)[: int(dense.ts_size)]
    begin, following = ends[ends < end][-1], ends[ends > end][0]
    assert end - begin > AT_ONCE
    inside = begin + (end - begin) * np.array([0.1, 0.5, 0.9])
    return np.concatenate([[0.0], inside, end + (following - end) * np.array([0.01, 0.3, 0.9])])


@pytest.mark.thorough
def test_a_ball_that_stops_slipping():
    """v = v₀ − μ g t until 2 v₀/(7 μ g), and 5 v₀/7 from then on, for a ball that was not turning."""
    start = ReleasedState(BallState(), V=(0.0, 1.5, 0.0), height=0.0)
    end = 2 * 1.5 / (7 * MU * G)

    def solve(times):
        return simulate(SOLID, times, start, contact=Contact(MU), rtol=TOLERANCE, atol=TOLERANCE, dense=True)

    run = solve([0.0, 1.0])
    times = times_around(run)
    slipping = 1.5 * times - MU * G * times**2 / 2
    rolling = 1.5 * end - MU * G * end**2 / 2 + 1.5 * 5 / 7 * (times - end)
    y = np.where(times < end, slipping, rolling)
    rate = np.minimum(5 / 2 * MU * G * times, 1.5 * 5 / 7)
    for state in (run.at(jnp.asarray(times)), solve(times).state):
        np.testing.assert_allclose(state.z[:, 1], y, rtol=0.0, atol=10 * TOLERANCE)
        np.testing.assert_allclose(np.abs(state.Omega[:, 0]), rate, rtol=0.0, atol=10 * TOLERANCE)


@pytest.mark.thorough
def test_a_spinning_ball_that_comes_to_rest():
    """Rolling ends after 7 v₀/(5 c g), when it still spins; both rates fall linearly."""
    ball = Ball(
        mass=1.0,
        radius=1.0,
        inertia=(0.4, 0.4, 0.4),
        gravity=G,
        resistance=Resistance(dry=0.1, dry_spinning=0.02, exact=True),
    )
    start = BallState(Omega=(0.6, 0.0, 0.9))
    end = 7 * 0.6 / (5 * 0.1 * G)

    def solve(times):
        return simulate(ball, times, start, rtol=TOLERANCE, atol=TOLERANCE, dense=True)

    run = solve([0.0, 1.2])
    times = times_around(run)
    left = np.maximum(end - times, 0.0)
    y = -0.5 * (5 / 7) * 0.1 * G * (end**2 - left**2)
    spin = 0.9 - 0.02 * G / 0.4 * times
    for state in (run.at(jnp.asarray(times)), solve(times).state):
        omega = np.einsum("tij,tj->ti", state.Lambda, state.Omega)
        np.testing.assert_allclose(state.z[:, 1], y, rtol=0.0, atol=10 * TOLERANCE)
        np.testing.assert_allclose(omega[:, 2], spin, rtol=0.0, atol=10 * TOLERANCE)
        np.testing.assert_allclose(omega[:, 0], (5 / 7) * 0.1 * G * left, rtol=0.0, atol=10 * TOLERANCE)
