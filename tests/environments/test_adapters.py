"""Adapters against what Gymnasium checks of environments, and against the environment that they adapt."""

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import jaxball
from jaxball.control.environments import Environment, ObservedSensors, ReachPoint, Uniform, in_lanes
from jaxball.physics.sensors import Encoder, SensorErrors
from tests.control import robots


@pytest.fixture(scope="module")
def environment():
    robot = robots.with_pendulum(jaxball.Motor(0.0, limit=1.0))
    return Environment(robot, ReachPoint(drawn=Uniform(-1.0, 1.0)), sample=0.1, samples=3)


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore:.*A Box observation space m..imum value is -?infinity")  # it has no bounds
def test_one_passes_gymnasiums_checks_and_seeds_determine_episodes(environment):
    single = environment.gymnasium()
    check_env(single, skip_render_check=True)  # what it warns of is an error here
    first, _ = single.reset(seed=5)
    again, _ = single.reset(seed=5)
    np.testing.assert_array_equal(first, again)
    following, _ = single.reset()
    assert not np.array_equal(following, first)
    ends = [single.step(np.zeros(1, np.float32))[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]


@pytest.mark.long
def test_many_are_reset_in_the_step_in_which_they_end(environment):
    """As Gymnasium's own SyncVectorEnv does in this mode: the last observation is in ``final_obs``."""
    gymnasium.register("PendulumRobot-v0", vector_entry_point=lambda num_envs: environment.gymnasium_vector(num_envs))
    many = gymnasium.make_vec("PendulumRobot-v0", num_envs=16, vectorization_mode="vector_entry_point")
    assert many.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    first, _ = many.reset(seed=7)
    again, _ = many.reset(seed=7)
    np.testing.assert_array_equal(first, again)
    assert first.shape == (16, environment.n_observations)
    assert first.dtype == np.float32
    assert many.observation_space.contains(first)
    for k in range(4):
        seen, rewards, terminated, truncated, infos = many.step(np.zeros((16, 1), np.float32))
        assert rewards.shape == terminated.shape == (16,)
        assert np.all(truncated == (k == 2))
        assert ("final_obs" in infos) == (k == 2)
        if k == 2:
            # At rest nothing moves: what is missed stays until the point is drawn again.
            np.testing.assert_array_equal(infos["final_obs"][:, -2], first[:, -2])
            assert np.all(infos["_final_obs"])
            assert not np.any(seen[:, -2] == first[:, -2])


@pytest.mark.long
def test_like_brax_it_is_the_environment_in_a_loop_that_keeps_what_wrappers_add(environment):
    like_brax = environment.brax()
    assert (like_brax.observation_size, like_brax.action_size) == (environment.n_observations, 1)
    key, actions = jax.random.PRNGKey(2), jnp.array([[0.5], [-0.2], [0.1]])

    @jaxball.jit
    def looped(key):
        start = like_brax.reset(key)
        start = start.replace(info=start.info | {"steps": jnp.zeros(())})

        def step(state, action):
            after = like_brax.step(state, action)
            return after, (after.obs, after.reward, after.done, after.info["truncation"])

        last, along = jax.lax.scan(step, start, actions)
        return last.info["steps"], along

    steps, (seen, rewards, done, truncation) = looped(key)
    episode, _ = environment.reset(key)
    single = jaxball.jit(environment.step)
    for k in range(3):
        after = single(episode, actions[k])
        episode = after.episode
        np.testing.assert_allclose(seen[k], after.observation, rtol=0, atol=1e-9)
        np.testing.assert_allclose(rewards[k], after.reward, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(done, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(truncation, done)
    assert float(steps) == 0.0


@pytest.mark.thorough
def test_sensors_read_with_their_errors():
    """At rest an encoder reads 0: what is observed is its bias and noise, over 4000 resets within four standard errors,
    and 0 where every reading is lost."""
    joint = "mechanisms[0].joints[0]"
    sensors = {
        "exact": Encoder(joint),
        "lost": Encoder(joint, errors=SensorErrors(bias=1.0, missing=1.0)),
        "noisy": Encoder(joint, errors=SensorErrors(bias=0.3, noise=0.2)),
    }
    robot = robots.with_pendulum(jaxball.Motor(0.0, limit=1.0))
    seeing = Environment(robot, ReachPoint(0.0), sample=0.1, observation=sensors, shows_goal=False)
    assert isinstance(seeing.observation, ObservedSensors)
    _, seen = jaxball.jit(in_lanes(seeing.reset))(jax.random.split(jax.random.key(0), 4000))
    exact, lost, noisy = seen.T
    np.testing.assert_array_equal(exact, 0.0)
    np.testing.assert_array_equal(lost, 0.0)
    assert np.mean(noisy) == pytest.approx(0.3, abs=4 * 0.2 / np.sqrt(4000))
    assert np.std(noisy) == pytest.approx(0.2, rel=4 / np.sqrt(8000))
