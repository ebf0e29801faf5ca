"""Goals in closed form, and observations that do not depend on where a robot is and which way it faces."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import BallState, DiskState
from jaxball.control.environments import (
    Environment,
    Factor,
    FollowPath,
    HoldSpeed,
    Normal,
    ObservedState,
    QuadraticReward,
    ReachPoint,
    Uniform,
    in_lanes,
)
from jaxball.control.environments.tasks import Moment
from jaxball.physics.sensors import Encoder, SensorErrors
from tests.control import robots
from tests.support.sentences import refuses

MOTOR = jaxball.Motor(0.0, limit=1.0)


def moment_of(state, t=0.0):
    motor = jaxball.Motor(0.0)
    robot = robots.ball_with_pendulum((motor, motor)) if isinstance(state, BallState) else robots.with_pendulum()
    return Moment(jnp.asarray(t), robot, state, jnp.zeros(len(robot.coordinates)))


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def turned(state, angle, shift):
    """The same state after a rotation about the vertical through the origin, and a shift."""
    c, s = np.cos(angle / 2), np.sin(angle / 2)
    q = np.asarray(state.q)
    product = [c * q[0] - s * q[3], c * q[1] - s * q[2], c * q[2] + s * q[1], c * q[3] + s * q[0]]
    return BallState(product, state.Omega, rotation(angle) @ np.asarray(state.z) + shift, state.theta, state.thetadot)


@pytest.fixture(scope="module")
def somewhere():
    rng = np.random.default_rng(4)
    q = rng.normal(size=4)
    return BallState(q / np.linalg.norm(q), rng.normal(size=3), rng.normal(size=2), rng.normal(size=2), [0.3, -0.7])


def test_what_is_observed_is_the_same_wherever_the_robot_is_and_whichever_way_it_faces(somewhere):
    """To rounding of numbers up to 10, after a hundred operations."""
    angle, shift, point = 1.1, np.array([2.0, -3.0]), np.array([0.7, 0.2])

    @jax.jit
    def observed(state, point):
        moment = moment_of(state)
        return jnp.concatenate(
            [ObservedState()(None, moment, (), jnp.ones(()))[0], ReachPoint().observe(point, moment)]
        )

    there = observed(turned(somewhere, angle, shift), rotation(angle) @ point + shift)
    np.testing.assert_allclose(there, observed(somewhere, point), rtol=0, atol=1e-13)


def test_what_is_observed_of_a_disk_in_closed_form():
    """φ turns the body from e1 to e3, and the pendulum hangs at θ − φ from below, at the length l."""
    phi, phidot, theta, thetadot, l = 0.4, -0.8, 0.9, 0.5, robots.LENGTH
    state = DiskState(phi=phi, phidot=phidot, z=2.0, theta=[theta], thetadot=[thetadot])
    seen, _ = jax.jit(lambda state: ObservedState()(None, moment_of(state), (), jnp.ones(())))(state)
    beta, rate = theta - phi, thetadot - phidot
    mass = [-l * np.sin(beta), -l * np.cos(beta)]
    velocity = [-l * np.cos(beta) * rate, l * np.sin(beta) * rate]
    expected = [-phidot, np.sin(phi), np.cos(phi), np.cos(theta), np.sin(theta), thetadot, *mass, *velocity]
    np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-14)


@pytest.mark.thorough
def test_what_a_path_and_a_speed_are_missed_by():
    """Half a unit after the start, at z = (1, 1), rolling along e1 with a velocity of 2."""
    rolling = BallState(Omega=(0.0, 2.0, 0.0), z=(1.0, 1.0), theta=(0.0, 0.0), thetadot=(0.0, 0.0))
    moment = moment_of(rolling, 0.5)
    path = FollowPath(jaxball.ConstantRate(0.0, rate=3.0), jaxball.ConstantRate(2.0, rate=1.0), preview=(1.0,))
    np.testing.assert_allclose(path.misses((), moment), [0.5, 1.5, 1.0, 1.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(path.observe((), moment), [0.5, 1.5, 1.0, 1.0, 3.5, 2.5], rtol=0, atol=1e-12)
    steps = jaxball.PiecewiseSignal([0.0, 1.0, 2.0], [1.5, -1.0])
    missed = HoldSpeed(steps).misses(jnp.asarray(2.0), moment_of(turned(rolling, 0.7, 0.0), 0.5))
    np.testing.assert_allclose(missed, [1.0, 0.0], rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"parameters": {"mas": Uniform(0.9, 1.1)}}, "parameters"),
        ({"starts": {"zz": Uniform(0.9, 1.1)}}, "starts"),
        ({"starts": {"theta": Normal(0, 1), "theta[0]": Normal(0, 1)}}, "starts"),
        ({"starts": {"z": 3.0}}, "starts['z']"),
        ({"sample": 0.0}, "sample"),
        ({"delay": (2, 1)}, "delay[1]"),
        ({"limits": np.inf}, "limits"),
        ({"goal": "there"}, "goal"),
        ({"state": BallState()}, "state"),
        ({"observation": {"joint": Encoder("masses[0]")}}, "sensors['joint'].on"),
        (
            {"observation": {"joint": Encoder("mechanisms[0].joints[0]", errors=SensorErrors(delay=0.1))}},
            "sensors['joint'].errors",
        ),
    ],
)
def test_what_does_not_fit_is_refused_in_a_sentence(no_type_checks, changes, named):
    given = {"goal": ReachPoint(0.0), "sample": 0.1} | changes
    with refuses((TypeError, ValueError), named):
        Environment(robots.with_pendulum(MOTOR), **given)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        (lambda: Uniform(1.0, 0.0), "high"),
        (lambda: Normal(0.0, -1.0), "deviation"),
        (lambda: Factor(2.0), "factor"),
        (lambda: ReachPoint((1.0, 2.0, 3.0)), "point"),
        (lambda: QuadraticReward(misses=[[1.0]]), "misses"),
        (lambda: in_lanes(3), "function"),
        (lambda: Environment(robots.with_pendulum(MOTOR), ReachPoint(0.0), sample=0.1).reset(5), "key"),
    ],
)
def test_other_arguments_are_refused_in_sentences(no_type_checks, wrong, named):
    with refuses((TypeError, ValueError), named):
        wrong()


AHEAD = jaxball.ConstantRate(0.0, rate=1.0)


@pytest.mark.parametrize(
    ("robot", "goal", "named"),
    [
        (robots.with_pendulum(MOTOR), ReachPoint((1.0, 2.0)), "point"),
        (robots.with_pendulum(MOTOR), FollowPath(AHEAD, AHEAD), "across"),
        (robots.ball_with_pendulum((MOTOR, MOTOR)), ReachPoint(1.0), "point"),
        (robots.ball_with_pendulum((MOTOR, MOTOR)), FollowPath(AHEAD), "across"),
    ],
)
def test_a_goal_has_as_many_coordinates_as_the_robot(robot, goal, named):
    """A ball that was to reach 1.0 went to (1, 1), and a disk left the second coordinate out."""
    with refuses(ValueError, named):
        Environment(robot, goal, sample=0.1)


@pytest.mark.parametrize(
    ("action", "error", "named"),
    [
        (0.5, ValueError, "action"),
        ([[0.5, 0.1]], ValueError, "action"),
        (np.zeros(3), ValueError, "action"),
        ("left", TypeError, "action"),
    ],
)
def test_an_action_is_a_number_for_each_input(no_type_checks, somewhere, action, error, named):
    """Of two inputs, a single number acted on both."""
    robot = robots.ball_with_pendulum((MOTOR, MOTOR))
    environment = Environment(robot, ReachPoint((0.0, 0.0)), sample=0.1, state=somewhere)
    episode = jax.eval_shape(environment.reset, jax.random.key(0))[0]
    with refuses(error, named):
        jax.eval_shape(lambda episode: environment.step(episode, action), episode)
    listed = jax.eval_shape(lambda episode: environment.step(episode, [0.5, 0.1]), episode)
    assert listed.reward.shape == ()


def test_a_step_is_of_an_episode(no_type_checks):
    environment = Environment(robots.with_pendulum(MOTOR), ReachPoint(0.0), sample=0.1)
    with refuses(TypeError, "episode"):
        environment.step(np.zeros(12), np.zeros(1))
