"""Inputs of every kind, from what moves a robot in its run: held, they give the motion of the run."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.control import tvlqr
from jaxball.control.sampled import SampledSystem
from tests.support.sentences import refuses

pytestmark = pytest.mark.thorough  # all share programs that take seconds to compile

H = 0.02
MOTOR = jaxball.Sinusoids(0.0, amplitude=[0.3], frequency=[3.0])
SLIDE = jaxball.Sinusoids(0.5, amplitude=[0.2], frequency=[2.0])
SPRING = jaxball.Spring(1.5) + jaxball.Damper(0.1)


def swing(t, state, strength):
    """A law that reads the state of the body."""
    return -strength * (state.theta[:1] + 0.2 * state.phidot)


@pytest.fixture(scope="module")
def run():
    """A disk with a mass on a rail that a schedule moves, one that a law drives, and a pendulum with a sprung motor."""
    masses = [
        jaxball.PointMass(0.3, jaxball.OnRail(jaxball.Circle(0.5), SLIDE)),
        jaxball.PointMass(0.2, jaxball.Driven(jaxball.Circle(0.4))),
    ]
    pendulum = jaxball.planar_pendulum(0.4, 0.6, drive=SPRING + jaxball.Motor(MOTOR, limit=2.0))
    disk = jaxball.Disk(
        mass=1.0,
        inertia=0.5,
        masses=masses,
        law=jaxball.FunctionLaw(swing, 2.0),
        mechanisms=[pendulum],
    )
    return jaxball.simulate(disk, [0.0, 1.0], jaxball.DiskState(theta=[0.4, 0.1], thetadot=[0.0, 0.0]))


@pytest.fixture(scope="module")
def track(run):
    return tvlqr(run, Q={"z": 1.0}, R=1.0, sample=H)


@pytest.mark.long
def test_masses_come_before_joints_and_the_limit_is_that_of_the_motor(track):
    assert track.inputs == ("masses[0]", "masses[1]", "mechanisms[0].joints[0]")
    np.testing.assert_array_equal(track.sampled.limits, [np.inf, np.inf, 2.0])
    assert track.sampled.system.coordinates == track.inputs


@pytest.mark.long
def test_the_limits_of_motors_stay(track):
    """Of a robot that is sampled already, and of one with the inputs that acted; those of other limits are these."""
    again = SampledSystem.of(track.sampled.system, H)
    np.testing.assert_array_equal(again.limits, track.sampled.limits)
    limits = [jnp.inf, 0.4, 0.05]
    loop = track.closed_loop({"z": 0.3}, limits=limits)
    assert bool(jnp.any(loop.saturated[:, 2]))
    np.testing.assert_array_equal(SampledSystem.of(loop.run.system, H).limits, [np.inf, np.inf, 0.05])
    np.testing.assert_allclose(loop.run.observables.joint_efforts[:-1, 0] - _passive(loop), loop.u[:, 2], atol=1e-12)


def _passive(loop):
    """The effort of the spring and the damper beside the motor."""
    return -1.5 * loop.states.theta[:-1, 2] - 0.1 * loop.states.thetadot[:-1, 2]


def test_inputs_are_means_of_schedules_laws_and_motors(track):
    """By the rule of two points, whose error over a sample is h⁴ / 4320 times a fourth derivative of at most 25."""
    t = np.asarray(track.times)
    slide = -0.2 * 2.0 * (np.cos(2 * t) - np.cos(2 * (t + H))) / H
    motor = 0.3 / 3.0 * (np.cos(3 * t) - np.cos(3 * (t + H))) / H
    np.testing.assert_allclose(track.nominal.u[:, 0], slide, rtol=0, atol=1e-9)
    np.testing.assert_allclose(track.nominal.u[:, 2], motor, rtol=0, atol=1e-9)
    states = track.nominal.states
    law = -2.0 * (states.theta[:, 1] + 0.2 * states.phidot)
    means = 0.5 * (law[:-1] + law[1:])  # whose error is h² / 12 times a second derivative of some 10
    np.testing.assert_allclose(track.nominal.u[:, 1], means, rtol=0, atol=1e-3)


def test_held_inputs_give_the_motion(run, track):
    """What a sample misses is of third order, so the end is missed by h² = 4e-4 times numbers of size 1."""
    loop = track.feedforward().closed_loop()
    np.testing.assert_allclose(loop.xi, 0, atol=H**2)
    assert float(jnp.max(jnp.abs(track.nominal.states.z - track.nominal.states.z[0]))) > 0.02
    assert float(loop.states.z[-1]) == pytest.approx(float(run.state.z[-1]), abs=H**2)


@pytest.mark.long
def test_a_joint_is_chosen_and_the_rest_moves_as_before(run):
    with refuses(ValueError, "inputs"):
        tvlqr(run, Q=1.0, R=1.0, inputs=["mechanisms[0].joints[0]"])
    chosen = tvlqr(run, Q=1.0, R=1.0, sample=H, inputs=["mechanisms[0].joints[0]", "masses[1]"])
    assert chosen.inputs == ("mechanisms[0].joints[0]", "masses[1]")
    assert chosen.directions[3:5] == ("theta[0]", "theta[1]")
    np.testing.assert_allclose(chosen.feedforward().closed_loop().xi, 0, atol=H**2)
