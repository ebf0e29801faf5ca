"""Robots with a law of contact in episodes and under feedback: each is one run of ``simulate`` with the same inputs."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Contact, Disk, Motor, Resistance, planar_pendulum, simulate
from jaxball.control import tvlqr
from jaxball.control.environments import Environment, ReachPoint
from jaxball.physics.sensors import Accelerometer
from tests.support.sentences import refuses

TIGHT = 1e-9
CONTACT = Contact(0.12, restitution=0.3)
KEY = jax.random.key(0)
TORQUE = 0.45


def robot():
    pendulum = planar_pendulum(0.5, 0.6, drive=Motor(0.0, limit=1.0))
    return Disk(mass=1.0, inertia=0.5, mechanisms=[pendulum], resistance=Resistance(dry=0.01, exact=True))


@functools.cache
def environment():
    sensors = {"shell": Accelerometer(at=(0.0, 0.0, 0.4))}
    numbers = {"sample": 0.1, "samples": 30, "rtol": TIGHT, "atol": TIGHT}
    return Environment(robot(), ReachPoint(2.0), contact=CONTACT, observation=sensors, shows_goal=False, **numbers)


@functools.cache
def episode():
    posed = environment()
    return jax.jit(lambda: posed.rollout(KEY, lambda seen: jnp.array([TORQUE])))()


@functools.cache
def one_run():
    held = environment().robot({}, jnp.array([TORQUE]))
    return simulate(held, np.linspace(0.0, 3.0, 31), contact=CONTACT, rtol=TIGHT, atol=TIGHT, throw=True)


@pytest.mark.thorough
def test_an_episode_is_one_run():
    taken, run = episode(), one_run()
    assert len(set(np.asarray(run.contact.mode).tolist())) > 1  # it slips and rolls
    np.testing.assert_array_equal(np.asarray(taken.episode.state.mode), np.asarray(run.contact.mode)[1:])
    for name in ("z", "phi", "phidot", "theta", "thetadot"):
        found, expected = getattr(taken.episode.state.body, name), getattr(run.state, name)[1:]
        np.testing.assert_allclose(found, expected, rtol=0, atol=100 * TIGHT)
    np.testing.assert_allclose(taken.episode.state.V, run.contact.V[1:], rtol=0, atol=100 * TIGHT)


@pytest.mark.thorough
def test_its_sensors_feel_the_slip():
    expected = one_run().measured(environment().observation.sensors)["shell"][1:]
    np.testing.assert_allclose(episode().observation, expected, rtol=0, atol=1e-6)


@pytest.mark.long
def test_the_gradient_of_its_return_is_that_of_differences():
    posed = environment()

    def total(torque):
        return jnp.sum(posed.rollout(KEY, lambda seen: jnp.reshape(torque, 1), samples=12).reward)

    slope, compiled = jax.jit(jax.grad(total))(TORQUE), jax.jit(total)
    np.testing.assert_allclose(slope, (compiled(TORQUE + 1e-4) - compiled(TORQUE - 1e-4)) / 2e-4, rtol=1e-5)


def test_friction_and_contact_exclude_each_other():
    with refuses(ValueError, "friction"):
        Environment(robot(), ReachPoint(2.0), sample=0.1, friction=0.3, contact=CONTACT)


@pytest.mark.long
def test_feedback_holds_a_robot_that_slips():
    body = Disk(mass=1.0, inertia=0.5, mechanisms=[planar_pendulum(0.5, 0.6, drive=Motor(0.0))])
    track = tvlqr(simulate(body, [0.0, 6.0]), Q={"phi": 1.0, "theta": 1.0}, R=1.0)
    rolls = track.closed_loop({"phi": 0.6})
    firm, slips = (track.closed_loop({"phi": 0.6}, contact=Contact(mu)) for mu in (5.0, 0.02))
    np.testing.assert_allclose(firm.xi, rolls.xi, rtol=0, atol=1e-6)
    run = slips.run
    assert int(run.switches.count) > 0
    np.testing.assert_allclose(run.state.phi, slips.states.phi, rtol=0, atol=1e-5)
    assert np.max(np.abs(np.asarray(slips.xi - rolls.xi))) > 1e-3
