"""The errors of sensors: their statistics, what arrives when, and what is exact about them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Disk, DiskState
from jaxball.physics import ReleasedState
from jaxball.physics.sensors import Accelerometer, Gyroscope, Position, SensorErrors
from tests.support.sentences import refuses

OMEGA = (0.3, -0.2, 0.1)
SAVED = np.arange(0.0, 2.0 + 1e-9, 0.1)


@pytest.fixture(scope="module")
def run():
    """A ball whose angular velocity stays as it is, since its moments are equal."""
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4))
    return jaxball.simulate(ball, SAVED, BallState(Omega=OMEGA))


@pytest.fixture(scope="module")
def long():
    """A disk at rest, at 2,001 times."""
    times = np.linspace(0.0, 20.0, 2_001)
    return jaxball.simulate(Disk(mass=1.0, inertia=0.5), times, DiskState())


def readings(run, sensor, key=None):
    return np.asarray(run.measured({"one": sensor}, key)["one"])


def test_noise_has_its_mean_and_deviation_and_no_correlation(long):
    """Each estimate is within five of its own standard deviations: 1/√n of the mean, 1/√2n of the deviation."""
    found = readings(long, Gyroscope(errors=SensorErrors(noise=0.3)))
    n = len(found)
    exact = readings(long, Gyroscope())
    noise = (found - exact) / 0.3
    assert np.abs(noise.mean(axis=0)).max() < 5 / np.sqrt(n)
    assert np.abs(noise.std(axis=0) - 1).max() < 5 / np.sqrt(2 * n)
    assert np.abs(np.mean(noise[1:] * noise[:-1], axis=0)).max() < 5 / np.sqrt(n)
    assert abs(np.mean(noise[:, 0] * noise[:, 1])) < 5 / np.sqrt(n)


def test_a_bias_wanders_as_a_random_walk(long):
    """From a constant value, by independent steps whose variance is proportional to time."""
    found = readings(long, Gyroscope(errors=SensorErrors(bias=(0.1, 0.2, 0.3), random_walk=0.05)))
    np.testing.assert_allclose(found[0], (0.1, 0.2, 0.3), rtol=0, atol=1e-15)
    steps = np.diff(found, axis=0) / (0.05 * np.sqrt(0.01))
    n = len(steps)
    assert np.abs(steps.mean(axis=0)).max() < 5 / np.sqrt(n)
    assert np.abs(steps.std(axis=0) - 1).max() < 5 / np.sqrt(2 * n)


def test_a_share_of_the_readings_is_lost(long):
    found = readings(long, Gyroscope(errors=SensorErrors(missing=0.2)))
    lost = np.isnan(found[:, 0])
    assert abs(lost.mean() - 0.2) < 5 * np.sqrt(0.2 * 0.8 / len(lost))
    np.testing.assert_array_equal(np.isnan(found), lost[:, None] * np.ones(3, bool))  # a reading as a whole


@pytest.mark.thorough
def test_readings_arrive_late_and_at_their_rate(run):
    """Of a position that grows in proportion to time, so that a reading tells when it was taken."""
    exact = readings(run, Position())
    found = readings(run, Position(errors=SensorErrors(rate=2.0, delay=0.3)))
    arrived = np.flatnonzero(~np.isnan(found[:, 0]))
    np.testing.assert_array_equal(arrived, [3, 8, 13, 18])
    np.testing.assert_array_equal(found[arrived], exact[arrived - 3])


@pytest.mark.thorough
def test_the_key_decides_and_other_sensors_do_not(run):
    noisy = SensorErrors(noise=1.0)
    both = {"first": Gyroscope(errors=noisy), "second": Gyroscope(errors=noisy)}
    found, alone = run.measured(both), run.measured({"second": both["second"]})
    np.testing.assert_array_equal(found["second"], alone["second"])
    assert not np.array_equal(found["first"], found["second"])
    again, other = run.measured(both, jax.random.key(0)), run.measured(both, jax.random.key(1))
    np.testing.assert_array_equal(found["first"], again["first"])
    assert not np.array_equal(found["first"], other["first"])
    np.testing.assert_array_equal(other["first"], run.measured(both, jax.random.PRNGKey(1))["first"])
    seeded = run.measured({"first": Gyroscope(errors=SensorErrors(noise=1.0, seed=1))})
    assert not np.array_equal(found["first"], seeded["first"])


@pytest.mark.thorough
def test_a_reading_is_linear_in_the_level_of_its_noise(run):
    """So its derivative is the noise itself, divided by that level."""

    def read(noise):
        return run.measured({"one": Gyroscope(errors=SensorErrors(noise=noise))})["one"]

    slope = jax.jacfwd(read)(jnp.array(0.5))
    np.testing.assert_allclose(slope, (read(0.5) - read(0.0)) / 0.5, rtol=0, atol=1e-14)


@pytest.mark.thorough
def test_runs_of_a_batch_have_different_noise():
    def solved(speed):
        return jaxball.simulate(Disk(mass=1.0, inertia=0.5), jnp.array([0.0, 1.0]), DiskState(phidot=speed))

    runs = eqx.filter_vmap(solved)(jnp.array([1.0, 1.0]))
    found = readings(runs, Gyroscope(errors=SensorErrors(noise=1.0)))
    assert found.shape == (2, 2, 3)
    assert not np.array_equal(found[0], found[1])


@pytest.mark.long
def test_a_position_is_that_of_a_marker_over_the_plane():
    """On a disk that is thrown: z₁ grows with its velocity, the height falls with g = 1, and the marker goes round."""
    start = ReleasedState(DiskState(phidot=-2.0), V=(0.5, 0.0, 0.3), height=1.0)
    run = jaxball.simulate(Disk(mass=1.0, inertia=0.5), SAVED, start, contact=Contact(friction=0.2))
    aloft = np.flatnonzero(SAVED < 1.5)
    t = SAVED[aloft]
    found = readings(run, Position(at=(0.0, 0.0, 0.5)))[aloft]
    centre = np.stack([0.5 * t, 0.0 * t, 1.0 + 0.3 * t - t**2 / 2], axis=1)
    # Rolling forwards, along e1, is a rotation about e2 that takes e3 to e1.
    marker = 0.5 * np.stack([np.sin(2.0 * t), 0.0 * t, np.cos(2.0 * t)], axis=1)
    np.testing.assert_allclose(found, centre + marker, rtol=0, atol=1e-9)  # ten times the solve's tolerance


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"noise": -1.0}, "noise"),
        ({"rate": 0.0}, "rate"),
        ({"missing": 1.5}, "missing"),
        ({"noise": (1.0, 2.0)}, "noise"),
    ],
)
def test_what_is_no_error_of_a_sensor_is_refused(arguments, named):
    with refuses(ValueError, named):
        SensorErrors(**arguments)


@pytest.mark.parametrize(
    ("errors", "named"),
    [
        (SensorErrors(rate=3.0), "sensors['one'].errors"),
        (SensorErrors(delay=0.05), "sensors['one'].errors"),
        (SensorErrors(bias=(1.0, 2.0)), "sensors['one'].errors.bias"),
    ],
)
def test_errors_that_do_not_fit_a_run_are_refused(run, errors, named):
    with refuses(ValueError, named):
        run.measured({"one": Accelerometer(errors=errors)})


def test_what_is_no_key_is_refused(run):
    with refuses(TypeError, "key"):
        run.measured({"one": Gyroscope(errors=SensorErrors(noise=1.0))}, 3)
