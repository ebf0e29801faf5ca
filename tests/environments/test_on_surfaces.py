"""Environments of bodies on surfaces, against runs of the same motion with schedules, in space."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Accelerated,
    Ball,
    BallState,
    Bowl,
    Circle,
    Driven,
    FunctionSchedule,
    OnRail,
    PointMass,
    Status,
    observe,
    simulate,
)
from jaxball.control.environments import Environment, ReachPoint
from jaxball.physics import TiltingPlane

SOLID = {"mass": 1.0, "radius": 0.05, "inertia": (0.001, 0.001, 0.001), "gravity": 9.81}
H, LIMIT, ACTIONS = 0.1, 2.0, np.array([0.5, -1.0, 0.25])
DIFFERENCE = 2e-4
FINE = {"rtol": 1e-10, "atol": 1e-10}


def angle(t, start):
    """The angle whose second derivative is each action in turn, times the limit, from ``start`` at rest."""
    value, rate = start, 0.0
    for k, action in enumerate(ACTIONS):
        s = jnp.clip(t - k * H, 0.0, H)
        value, rate = value + s * (rate + 0.5 * LIMIT * action * s), rate + LIMIT * action * s
    return value


def along(step, begun):
    transitions, episode = [], begun
    for action in ACTIONS:
        transitions.append(step(episode, jnp.array([action])))
        episode = transitions[-1].episode
    return transitions


def require_motion(environment, run):
    """Places and velocities of the centre, as misses of the goal at the origin, are those of a run in space."""
    episode, _ = environment.reset(jax.random.key(0))
    transitions = along(jaxball.jit(environment.step), episode)
    seen = run.observables
    for k, after in enumerate(transitions):
        assert after.info["status"] == Status.SUCCESS
        np.testing.assert_allclose(-after.info["misses"][:2], seen.geometric_centre[k + 1, :2], atol=1e-8)
        # The velocity by a difference of second order of places before, as the acceleration jumps.
        times = [H * (k + 1) - d for d in (0.0, DIFFERENCE, 2 * DIFFERENCE)]
        c = [np.asarray(observe(run.system, jnp.array(t), run.at(t)).geometric_centre[:2]) for t in times]
        velocity = (3 * c[0] - 4 * c[1] + c[2]) / (2 * DIFFERENCE)
        np.testing.assert_allclose(-after.info["misses"][2:], velocity, atol=1e-6)
    return transitions


@pytest.mark.thorough
def test_a_plate_that_a_policy_tilts():
    """The action is the angular acceleration of the plate; the policy sees its angle and rate."""
    plate = TiltingPlane(about_e2=Accelerated())
    ball = Ball(**SOLID, ground=plate, law=jaxball.FunctionLaw(lambda t, state, _: 0 * state.theta))
    state = BallState(z=(0.1, -0.2), Omega=(0.0, 1.0, 0.0), theta=[0.0], thetadot=[0.0])
    environment = Environment(ball, ReachPoint(), sample=H, limits=LIMIT, state=state, **FINE)
    tilted = Ball(**SOLID, ground=TiltingPlane(about_e2=FunctionSchedule(lambda t, _: angle(t, 0.0))))
    start = BallState(z=(0.1, -0.2), Omega=(0.0, 1.0, 0.0))
    run = simulate(tilted, np.arange(4) * H, start, rtol=1e-11, atol=1e-12, dense=True)
    after = require_motion(environment, run)[-1]
    # Of the state: the velocity, the spin, the vertical, and then the plate.
    np.testing.assert_allclose(after.observation[6], angle(3 * H, 0.0), atol=1e-12)
    np.testing.assert_allclose(after.observation[7], LIMIT * H * ACTIONS.sum(), atol=1e-12)


@pytest.mark.thorough
def test_a_ball_in_a_bowl():
    """The action is the angular acceleration of a mass on a circle within the ball."""
    masses = {
        "driven": PointMass(0.5, Driven(Circle(0.03))),
        "scheduled": PointMass(0.5, OnRail(Circle(0.03), FunctionSchedule(lambda t, _: angle(t, -1.0)))),
    }
    law = jaxball.FunctionLaw(lambda t, state, _: 0 * state.theta)
    ball = Ball(**SOLID, masses=[masses["driven"]], ground=Bowl(0.5), law=law)
    state = BallState(z=(0.1, 0.05), theta=[-1.0], thetadot=[0.0])
    environment = Environment(ball, ReachPoint(), sample=H, limits=LIMIT, state=state, friction=5.0, **FINE)
    other = Ball(**SOLID, masses=[masses["scheduled"]], ground=Bowl(0.5))
    run = simulate(other, np.arange(4) * H, BallState(z=(0.1, 0.05)), rtol=1e-11, atol=1e-12, dense=True)
    require_motion(environment, run)


@pytest.mark.thorough
def test_a_ball_that_slips_on_a_slope():
    """A solid ball needs a friction of (2/7) tan a."""
    plate = TiltingPlane(about_e2=Accelerated())
    ball = Ball(**SOLID, ground=plate, law=jaxball.FunctionLaw(lambda t, state, _: 0 * state.theta))
    state = BallState(theta=[0.5], thetadot=[0.0])
    for share, status in ((0.98, Status.SLIPPED), (1.02, Status.SUCCESS)):
        friction = share * 2 / 7 * np.tan(0.5)
        environment = Environment(ball, ReachPoint(), sample=H, limits=LIMIT, state=state, friction=friction)
        after = jaxball.jit(environment.step)(environment.reset(jax.random.key(0))[0], jnp.zeros(1))
        assert after.info["status"] == status
        assert bool(after.terminated) == (status == Status.SLIPPED)
