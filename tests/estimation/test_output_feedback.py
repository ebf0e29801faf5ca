"""Feedback from sensors: with good sensors that of the state, with poor ones better than none."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.control import tvlqr
from jaxball.control.estimation import ErrorStateFilter, OutputFeedback
from jaxball.physics.sensors import Accelerometer, Encoder, Gyroscope, Position, SensorErrors
from tests.control import robots
from tests.support.sentences import refuses

H = 0.05
JOINT = "mechanisms[0].joints[0]"
START = {"phi": 0.3, "z": -0.3, "thetadot": -0.2}
SPREAD = {"phi": 0.3, "phidot": 0.1, "z": 0.3, "theta": 0.1, "thetadot": 0.3}


pytestmark = pytest.mark.thorough  # all share programs that take seconds to compile


@pytest.fixture(scope="module")
def track():
    """A disk that its pendulum holds at rest."""
    run = jaxball.simulate(robots.with_pendulum(jaxball.Motor(0.0)), [0.0, 6.0])
    return tvlqr(run, Q={"phi": 1.0, "theta": 1.0}, R=1.0, sample=H)


def sensors(noise, **errors):
    return {
        "joint": Encoder(JOINT, errors=SensorErrors(noise=noise)),
        "camera": Position(errors=SensorErrors(noise=noise, **errors)),
        "gyro": Gyroscope(errors=SensorErrors(noise=noise)),
    }


@pytest.mark.long
def test_with_nearly_exact_sensors_it_is_feedback_of_the_state(track):
    """Of what the first reading tells, φ̇ and θ; the difference is of the size of the noise, times gains of up to 10."""
    start = {"phidot": 0.2, "theta": 0.1}
    seen = OutputFeedback.of(track, sensors(1e-7), spread=start).closed_loop(start)
    exact = track.closed_loop(start)
    np.testing.assert_allclose(seen.xi, exact.xi, rtol=0, atol=1e-5)


@pytest.mark.long
def test_poor_sensors_are_better_than_none_and_tell_how_good_they_are(track):
    poor = OutputFeedback.of(track, sensors(0.02, missing=0.5), spread=SPREAD)
    held = poor.closed_loop(START)
    free = track.feedforward().closed_loop(START)
    assert float(jnp.linalg.norm(held.xi[-20:, 3])) < 0.3 * float(jnp.linalg.norm(free.xi[-20:, 3]))
    errors = held.xi[:-1] - held.memory.xi
    within = jnp.abs(errors) <= 3 * held.memory.deviations + 1e-12
    assert float(jnp.mean(within)) > 0.95  # of a normal distribution, 0.997; errors of one run are correlated


def test_a_robot_with_other_parameters_is_held(track):
    """Nearly as by the feedback of its state: in the end to a tenth of the deviation at the start."""
    other = robots.with_pendulum(jaxball.Motor(0.0), mass=1.1)
    seeing = OutputFeedback.of(track, sensors(0.001), spread=SPREAD, process={"phidot": 0.05}, system=other)
    held, exact = seeing.closed_loop(START, system=other), track.closed_loop(START, system=other)
    np.testing.assert_allclose(held.xi[-20:], exact.xi[-20:], rtol=0, atol=0.03)


@pytest.mark.long
def test_late_readings_are_taken_for_what_they_were(track):
    """At each sample it knows what the filter of a log knows, of which nothing has been read since.

    That filter is given the inputs that acted: limited, and two samples late. The regulator's inputs and both programs'
    solves differ by their tolerances of 1e-10. What an accelerometer feels jumps with the inputs: it is of just before.
    """
    late = sensors(0.02) | {"camera": Position(errors=SensorErrors(noise=0.02, missing=0.2, delay=3 * H))}
    late |= {"felt": Accelerometer(at=(0.3, 0.0, 0.4), errors=SensorErrors(noise=0.02))}
    loop = OutputFeedback.of(track, late, spread=SPREAD).closed_loop(START, limits=0.1, delay=2)
    assert bool(loop.saturated.any())
    read = loop.run.measured(late)
    known = ErrorStateFilter.for_sampled_system(track.sampled, late)
    for k in (1, 2, 40):
        log = {name: values[: k + 1] for name, values in read.items()}
        found = known(log, track.nominal.state(0), SPREAD, u=loop.u[:k])
        last = jax.tree.map(lambda leaf: leaf[-1], found.state)
        xi = track.nominal.state(k).difference(last)
        np.testing.assert_allclose(loop.memory.xi[k], xi, rtol=0, atol=1e-7)
        np.testing.assert_allclose(loop.memory.P[k], found.covariance[-1], rtol=0, atol=1e-8)
    estimate = loop.run.history.estimate
    np.testing.assert_array_equal(np.isnan(estimate.nis), np.arange(121) > 116)
    degrees = np.asarray(estimate.read)[:117]
    assert set(degrees) == {7, 10}


def test_a_delay_between_samples_is_refused(track):
    late = {"camera": Position(errors=SensorErrors(noise=0.1, delay=1.5 * H))}
    with refuses(ValueError, "sensors['camera'].errors.delay"):
        OutputFeedback.of(track, late, spread=SPREAD)


@pytest.mark.slow
def test_the_derivative_of_the_cost_by_the_place_of_an_accelerometer(track):
    """Against central differences, with steps of 1e-4 of a place of size 1: 1e-8 of the third derivative, and the
    tolerance of solves over the step, 1e-6.
    """
    noise = SensorErrors(noise=0.02)

    def cost(by):
        place = jnp.array([0.3, 0.0, 0.4]) + by * jnp.array([1.0, 0.0, -0.5])
        sensors = {"imu": Accelerometer(at=place, errors=noise), "joint": Encoder(JOINT, errors=noise)}
        seeing = OutputFeedback.of(track, sensors, spread=SPREAD, process={"phidot": 0.1})
        loop = seeing.closed_loop(START, samples=20)
        return track.cost(loop.xi, loop.du)

    slope = float(jaxball.jit(jax.jacfwd(cost))(jnp.array(0.0)))
    compiled = jaxball.jit(cost)
    expected = (float(compiled(jnp.array(1e-4))) - float(compiled(jnp.array(-1e-4)))) / 2e-4
    assert abs(expected) > 1e-3
    assert slope == pytest.approx(expected, rel=1e-3)
