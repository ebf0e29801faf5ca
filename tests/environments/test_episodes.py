"""Episodes against runs with the same inputs, the distributions drawn from, and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Status
from jaxball.control.environments import (
    Environment,
    Factor,
    Normal,
    QuadraticReward,
    ReachPoint,
    Uniform,
    in_lanes,
)
from jaxball.control.sampled import SampledSystem
from tests.control import robots

H, LIMIT, LANES = 0.1, 0.6, 16
MASS = Uniform(0.8, 1.2)


def with_limits(**changes):
    return robots.with_pendulum(jaxball.Motor(0.0, limit=LIMIT), **changes)


@pytest.fixture(scope="module")
def environment():
    """A disk that its pendulum drives, with everything drawn that can be; two thirds of episodes are late."""
    return Environment(
        with_limits(),
        ReachPoint(drawn=Uniform(1.0, 3.0)),
        sample=H,
        samples=5,
        reward=QuadraticReward(misses=(1.0, 0.1), inputs=0.3),
        starts={"z": Uniform(-1.0, 1.0), "theta": Normal(0.1, 0.2)},
        parameters={"mass": MASS, "mechanisms[0].mass": Factor(Normal(1.0, 0.05))},
        delay=(0, 2),
        rtol=1e-10,
        atol=1e-10,
    )


@pytest.fixture(scope="module")
def many(environment):
    """4000 episodes at their start, and the observations there."""
    return jaxball.jit(in_lanes(environment.reset))(jax.random.split(jax.random.key(3), 4000))


@pytest.fixture(scope="module")
def begun(many):
    """The first sixteen of them."""
    return jax.tree.map(lambda leaf: leaf[:LANES], many)


@pytest.fixture(scope="module")
def step(environment):
    """``step_or_reset`` of sixteen lanes."""
    return jaxball.jit(in_lanes(environment.step_or_reset))


@pytest.fixture(scope="module")
def actions():
    """Actions of every lane for six steps, some of them beyond their limits."""
    return jnp.asarray(np.random.default_rng(0).uniform(-1.5, 1.5, (6, LANES, 1)))


@pytest.fixture(scope="module")
def taken(step, begun, actions):
    """The transitions of all lanes, in six steps."""
    episodes, transitions = begun[0], []
    for row in actions:
        transitions.append(step(episodes, row))
        episodes = transitions[-1].episode
    return transitions


def lane(tree, j):
    return jax.tree.map(lambda leaf: leaf[j], tree)


def late_lanes(episodes):
    return {int(delay): j for j, delay in enumerate(episodes.delay)}


@pytest.mark.long
@pytest.mark.parametrize("delay", [0, 1, 2])
def test_an_episode_is_the_run_of_the_drawn_robot_with_inputs_shifted_by_the_delay(begun, taken, actions, delay):
    """Both solve with tolerances of 1e-10, over five samples or at once."""
    j = late_lanes(begun[0])[delay]
    episode = lane(begun[0], j)
    asked = LIMIT * np.clip(actions[:5, j], -1.0, 1.0)
    u = np.concatenate([np.zeros((delay, 1)), asked])[:5, 0]
    times = H * np.arange(6)
    motor = jaxball.Motor(jaxball.PiecewiseSignal(times, u))
    pendulum = jaxball.planar_pendulum(episode.parameters["mechanisms[0].mass"][0], robots.LENGTH, drive=motor)
    disk = jaxball.Disk(
        mass=episode.parameters["mass"], inertia=robots.INERTIA, gravity=robots.GRAVITY, mechanisms=[pendulum]
    )
    run = jaxball.simulate(disk, times, episode.state, rtol=1e-10, atol=1e-10)
    for k in range(5):
        misses = taken[k].info["misses"][j]
        expected = np.stack([episode.target[0] - run.state.z[k + 1], robots.RADIUS * run.state.phidot[k + 1]])
        np.testing.assert_allclose(misses, expected, rtol=0, atol=1e-8)
        np.testing.assert_allclose(taken[k].info["u"][j], u[k : k + 1], rtol=0, atol=1e-12)
        reward = -H * (expected[0] ** 2 + 0.1 * expected[1] ** 2 + 0.3 * u[k] ** 2)
        np.testing.assert_allclose(taken[k].reward[j], reward, rtol=0, atol=1e-8)


@pytest.mark.thorough
def test_an_episode_that_is_over_is_followed_by_another_and_its_last_observation_is_kept(taken):
    for k in range(4):
        assert not np.any(taken[k].terminated | taken[k].truncated)
        np.testing.assert_array_equal(taken[k].observation, taken[k].info["final_observation"])
    last = taken[4]
    assert np.all(last.truncated)
    assert not np.any(last.terminated)
    np.testing.assert_array_equal(last.episode.k, 0)
    np.testing.assert_array_equal(taken[5].episode.k, 1)
    # The last two numbers observed are what the goal is missed by, which of these is that of the step.
    np.testing.assert_array_equal(last.info["final_observation"][:, -2:], last.info["misses"])
    assert np.all(np.abs(last.observation - last.info["final_observation"])[:, -2] > 1e-3)  # another point
    assert len(np.unique(last.episode.parameters["mass"])) == LANES
    assert not np.any(np.isin(last.episode.parameters["mass"], taken[3].episode.parameters["mass"]))


@pytest.mark.thorough
def test_draws_have_the_distributions_that_were_asked_for(many):
    """Means and deviations of 4000 draws, within four of their standard errors; bounds exactly."""
    episodes, n = many[0], 4000
    mass, bob = episodes.parameters["mass"], episodes.parameters["mechanisms[0].mass"][:, 0] / robots.WEIGHT
    uniform = 1 / np.sqrt(12)
    for drawn, mean, deviation in [
        (mass, 1.0, 0.4 * uniform),
        (bob, 1.0, 0.05),
        (episodes.state.z, 0.0, 2.0 * uniform),
        (episodes.state.theta[:, 0], 0.1, 0.2),
        (episodes.target[:, 0], 2.0, 2.0 * uniform),
    ]:
        assert np.mean(drawn) == pytest.approx(mean, abs=4 * deviation / np.sqrt(n))
        assert np.std(drawn) == pytest.approx(deviation, rel=4 / np.sqrt(2 * n))
    assert 0.8 <= np.min(mass) < 0.801
    assert 1.199 < np.max(mass) <= 1.2
    shares = np.bincount(episodes.delay, minlength=3) / n
    np.testing.assert_allclose(shares, 1 / 3, rtol=0, atol=4 * np.sqrt(2 / 9 / n))
    together = np.corrcoef(np.stack([mass, bob, episodes.state.z, episodes.target[:, 0]]))
    np.testing.assert_allclose(together, np.eye(4), rtol=0, atol=4 / np.sqrt(n))
    np.testing.assert_array_equal(episodes.state.phi, 0.0)


@pytest.mark.thorough
def test_draws_do_not_depend_on_the_order_of_their_names(environment):
    """Nor on what JAX has done to the environment, whose dictionaries it returns in the order of their keys."""
    returned = jax.tree.map(lambda leaf: leaf, environment)
    assert list(returned.starts) != list(environment.starts)
    drawn = [jaxball.jit(one.reset)(jax.random.key(5))[0] for one in (environment, returned)]
    np.testing.assert_array_equal(drawn[0].state.z, drawn[1].state.z)
    np.testing.assert_array_equal(drawn[0].state.theta, drawn[1].state.theta)
    assert drawn[0].state.z != 0


@pytest.mark.thorough
def test_a_failed_solve_ends_the_episode_with_its_status_where_it_was(step, begun):
    """The lane whose action is no number, and acts at once, is observed as before; the others go on."""
    episodes, seen = begun
    j = late_lanes(episodes)[0]
    after = step(episodes, jnp.zeros((LANES, 1)).at[j].set(jnp.nan))
    assert Status(int(after.info["status"][j])) in (Status.IMPOSSIBLE, Status.NOT_FINITE)
    np.testing.assert_array_equal(np.flatnonzero(after.terminated), [j])
    assert not np.any(after.truncated)
    np.testing.assert_array_equal(after.info["final_observation"][j], seen[j])
    for number in (after.observation, after.reward, after.info["u"], after.info["misses"]):
        assert np.all(np.isfinite(number))


@pytest.mark.long
def test_a_goal_that_is_reached_terminates_and_slipping_does_too():
    """At rest at its point the disk has reached it; a torque of 0.6 needs more friction than 0.01."""
    there = Environment(with_limits(), ReachPoint(0.0, within=0.1), sample=H, friction=0.01, penalty=5.0)
    episode, _ = there.reset(jax.random.key(0))
    assert repr(episode).endswith("key=key<fry>[])")
    step = jaxball.jit(there.step)
    after = step(episode, jnp.zeros(1))
    assert (bool(after.terminated), int(after.info["status"]), float(after.reward)) == (True, 0, 0.0)
    slipped = step(episode, jnp.ones(1))
    assert bool(slipped.terminated)
    assert int(slipped.info["status"]) == Status.SLIPPED
    assert float(slipped.reward) < -4.9


@pytest.mark.long
def test_gradients_through_twenty_steps_are_those_of_differences(environment):
    """By the gains of a linear policy. Central differences of 1e-4 of a cost of order 10 miss by about 1e-7."""
    gains = jnp.asarray(0.05 * np.random.default_rng(1).normal(size=(1, environment.n_observations)))

    def cost(gains):
        run = environment.rollout(jax.random.key(5), lambda seen: jnp.tanh(gains @ seen), samples=20)
        return jnp.sum(run.info["misses"] ** 2)

    compiled = jaxball.jit(jax.value_and_grad(cost))
    value, gradient = compiled(gains)
    assert float(value) > 1.0
    for k in range(0, gains.size, 3):
        step = 1e-4 * jnp.zeros_like(gains).at[0, k].set(1.0)
        difference = (compiled(gains + step)[0] - compiled(gains - step)[0]) / 2e-4
        assert float(gradient[0, k]) == pytest.approx(float(difference), rel=1e-5, abs=1e-6)


@pytest.mark.long
def test_of_a_rejected_step_that_is_not_finite_nothing_remains_in_derivatives():
    """A pendulum that passes its yoke's axis, where its equations are singular, at a rate of 67: derivatives in reverse
    mode are those in forward mode, to the tolerances of 1e-10 times what they grow by."""
    motor = jaxball.Motor(0.0)
    robot = jaxball.Ball(
        mass=1.0,
        inertia=(0.4, 0.4, 0.4),
        gravity=10.0,
        mechanisms=[jaxball.spherical_pendulum(0.8, 0.5, drives=(motor, motor))],
    )
    sampled = SampledSystem.of(robot, 0.1)
    q = np.array([0.591, 0.735, -0.145, -0.299])
    state = jaxball.BallState(
        q=q / np.linalg.norm(q), Omega=(0.781, -0.0894, 1.155), theta=(2.0756, 1.5495), thetadot=(67.24, 7.957)
    )

    def end(u):
        return sampled.flow(jnp.zeros(()), state, u).thetadot[0]

    u = jnp.array([0.8, -0.9])
    back = jaxball.jit(jax.grad(end))(u)
    forward = jaxball.jit(jax.jacfwd(end))(u)
    assert np.all(np.isfinite(back))
    np.testing.assert_allclose(back, forward, rtol=1e-6)
