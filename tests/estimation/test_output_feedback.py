"""Feedback from sensors: with good sensors that of the state, with poor ones better than none."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.control import Feedforward, closed_loop, tvlqr
from jaxball.estimation import OutputFeedback
from jaxball.sensors import Encoder, Gyroscope, Position, SensorErrors
from tests.control import robots

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


def test_with_nearly_exact_sensors_it_is_feedback_of_the_state(track):
    """Of what the first reading tells, φ̇ and θ; the difference is of the size of the noise, times gains of up to 10."""
    start = {"phidot": 0.2, "theta": 0.1}
    seen = closed_loop(OutputFeedback.of(track, sensors(1e-7), spread=start), start)
    exact = closed_loop(track, start)
    np.testing.assert_allclose(seen.xi, exact.xi, rtol=0, atol=1e-5)


def test_poor_sensors_are_better_than_none_and_tell_how_good_they_are(track):
    poor = OutputFeedback.of(track, sensors(0.02, missing=0.5), spread=SPREAD)
    held = closed_loop(poor, START)
    free = closed_loop(Feedforward(track.sampled, track.nominal), START)
    assert float(jnp.linalg.norm(held.xi[-20:, 3])) < 0.3 * float(jnp.linalg.norm(free.xi[-20:, 3]))
    errors = held.xi[:-1] - held.memory.xi
    within = jnp.abs(errors) <= 3 * held.memory.deviations + 1e-12
    assert float(jnp.mean(within)) > 0.95  # of a normal distribution, 0.997; errors of one run are correlated


def test_a_robot_with_other_parameters_is_held(track):
    """Nearly as by the feedback of its state: in the end to a tenth of the deviation at the start."""
    other = robots.with_pendulum(jaxball.Motor(0.0), mass=1.1)
    seeing = OutputFeedback.of(track, sensors(0.001), spread=SPREAD, process={"phidot": 0.05}, system=other)
    held, exact = closed_loop(seeing, START, system=other), closed_loop(track, START, system=other)
    np.testing.assert_allclose(held.xi[-20:], exact.xi[-20:], rtol=0, atol=0.03)


def test_a_late_sensor_is_refused(track):
    late = {"camera": Position(errors=SensorErrors(noise=0.1, delay=H))}
    with pytest.raises(ValueError, match=r"`sensors\['camera'\]\.errors\.delay` must be 0 for feedback"):
        OutputFeedback.of(track, late, spread=SPREAD)
