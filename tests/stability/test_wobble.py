"""Charts of Floquet multipliers: a pendulum-driven robot that wobbles, against runs; what charts say and draw."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import plot
from jaxball.analysis.stability import floquet_chart
from jaxball.simulation.ensemble import simulate_ensemble
from tests.stability.test_periodic import FREE_SPEED, GRAVITY, LENGTH, STALL, UNEQUAL, WEIGHT
from tests.support.sentences import refuses

SPEEDS, ROLLING, TURNS = np.array([1.5, 2.0, 2.25, 3.0]), np.array([0.1, 0.7]), 20


def rolling_along(rolling, speed):
    """A robot whose moments about the axes across the hinge differ, as it rolls straight on, and its period."""
    torque = rolling * speed
    motor = jaxball.physics.SpeedLimitedMotor(-(speed / FREE_SPEED + torque / STALL), STALL, FREE_SPEED)
    ball = jaxball.Ball(
        mass=1.0,
        inertia=UNEQUAL,
        gravity=GRAVITY,
        mechanisms=[jaxball.planar_pendulum(WEIGHT, LENGTH, drive=motor)],
        resistance=jaxball.Resistance(rolling=rolling),
    )
    ahead = jnp.arcsin(torque / (WEIGHT * GRAVITY * LENGTH))
    state = jaxball.BallState(Omega=speed * jnp.eye(3)[1], theta=-ahead[None], thetadot=-speed[None])
    return ball, state, 2 * jnp.pi / speed


@pytest.fixture(scope="module")
def chart():
    return floquet_chart(rolling_along, {"rolling": ROLLING, "speed": SPEEDS}, chunk=8)


def growth(times, deviations):
    """Of a sum of three multipliers, by d[k + 3] = a d[k + 2] + b d[k + 1] + c d[k] (Prony)."""
    size = np.linalg.norm(deviations, axis=1)
    end = np.flatnonzero((size > 1e-9) & (np.maximum.accumulate(size) < 3e-3))[-1] + 1
    start = min(6, end - 8)
    shifted = np.stack([deviations[start + k : end - 3 + k] / size[start : end - 3, None] for k in range(4)])
    coefficients = np.linalg.lstsq(shifted[:3].reshape(3, -1).T, shifted[3].ravel(), rcond=1e-3)[0]
    return np.log(np.max(np.abs(np.roots([1.0, *-coefficients[::-1]])))) / (times[1] - times[0])


@pytest.mark.long
def test_runs_grow_where_the_chart_says_and_as_fast(chart):
    """From 1e-5 beside steady rolling, in the full state, whose rate is known to two per cent from twenty turns.

    The band of speeds at which the robot wobbles is that between 1.9 and 2.4, and a resistance of 0.7 has ended it.
    """
    rolling, speeds = (grid.ravel() for grid in np.meshgrid(ROLLING, SPEEDS, indexing="ij"))
    robots, states, periods = jax.vmap(rolling_along)(jnp.asarray(rolling), jnp.asarray(speeds))
    tilted = jnp.zeros_like(states.q).at[:, :2].set(jnp.array([1.0, 5e-6]))
    states = jaxball.BallState(tilted, states.Omega * (1 + 1e-5), states.z, states.theta, states.thetadot)
    times = np.asarray(periods)[:, None] * np.arange(TURNS + 1)
    run = simulate_ensemble(robots, times, states, rtol=1e-13, atol=1e-13, lanes=8).trajectory
    assert np.all(run.status == 0)
    q, Omega, thetadot = map(np.asarray, (run.state.q, run.state.Omega, run.state.thetadot[..., 0]))
    height = 2 * (q[..., 2] * q[..., 3] + q[..., 0] * q[..., 1])
    along = [Omega[..., 1] - speeds[:, None], thetadot + speeds[:, None]]
    deviations = np.stack([height, Omega[..., 0], Omega[..., 2], *along], axis=-1)
    seen = np.array([growth(*row) for row in zip(times, deviations, strict=True)])
    expected = chart["growth"].values.ravel()
    np.testing.assert_array_equal(np.sign(expected), [-1, 1, 1, -1, -1, -1, -1, -1])
    np.testing.assert_allclose(seen, expected, rtol=0.02)


@pytest.mark.thorough
def test_a_wobbling_hinge_goes_up_and_down_once_in_a_turn(chart):
    """The multiplier is real and positive, as of a deviation that comes back with the body's turn."""
    assert chart["closed"].all()
    wobbling = chart["growth"].values > 0
    np.testing.assert_allclose(chart["angle"].values[wobbling], 0, atol=1e-9)
    logarithms = np.log(chart["multiplier"]) / chart["period"]
    np.testing.assert_allclose(logarithms, chart["growth"], atol=1e-12)
    np.testing.assert_allclose(chart["period"].values, np.tile(2 * np.pi / SPEEDS, (2, 1)), rtol=1e-10)
    # The balance of steady rolling leaves the plane to carry the weight.
    np.testing.assert_allclose(chart["least_normal_force"], (1.0 + WEIGHT) * GRAVITY, rtol=1e-8)


@pytest.mark.thorough
def test_the_picture_has_the_rates_and_a_line_between(chart):
    ax = plot.chart(chart, largest=0.1)
    mesh = ax.collections[0]
    np.testing.assert_array_equal(mesh.get_array().ravel(), chart["growth"].values.ravel())
    assert mesh.get_clim() == (-0.1, 0.1)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("speed", "rolling")
    border = np.concatenate([path.vertices for path in ax.collections[1].get_paths()])
    assert np.all((border[:, 0] > 1.5) & (border[:, 0] < 3.0))
    unknown = chart.copy()
    unknown["growth"] = chart["growth"].where(chart["speed"] < 2.1)
    (key,) = plot.chart(unknown).get_legend().get_texts()
    assert key.get_text() == "no periodic motion found"
    assert plot.chart(chart.isel(rolling=slice(0, 1))).collections


def test_wrong_parameters():
    with refuses(ValueError, "parameters"):
        floquet_chart(rolling_along, {"rolling": [0.1]})
    for speeds in ([[1.0]], []):
        with refuses(ValueError, "speed"):
            floquet_chart(rolling_along, {"rolling": [0.1], "speed": speeds})
