"""Adapters to what libraries of reinforcement learning take: environments of Gymnasium, and the interface of Brax."""

import dataclasses
import importlib.util
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.arguments import require, whole_number
from ..interface.printing import Printed
from ..interface.wording import pip_install
from .environment import Environment, Episode

if TYPE_CHECKING:
    import gymnasium


def gymnasium_env(environment: Environment) -> "gymnasium.Env":
    """Returns the environment as a ``gymnasium.Env``.

    Observations and actions are arrays of float32; actions are from −1 to 1. ``reset(seed=...)`` determines all that
    follows. ``info`` has ``status``, ``misses`` and ``u`` of a step.

    **Arguments:**

    - ``environment``: the environment.

    **Raises:** ``ImportError`` where Gymnasium is not installed.
    """
    _require(environment)
    from .gymnasium_classes import JaxballEnv

    return JaxballEnv(environment)


def gymnasium_vector_env(environment: Environment, num_envs: int) -> "gymnasium.vector.VectorEnv":
    """Makes many copies of the environment side by side as a ``gymnasium.vector.VectorEnv``, compiled as one program.

    An episode that is over is followed by a new one in the same step, ``AutoresetMode.SAME_STEP``, as its ``metadata``
    say: ``info["final_obs"]`` has the observation at its end where ``info["_final_obs"]`` is true.

    **Arguments:**

    - ``environment``: the environment.
    - ``num_envs``: how many.

    **Raises:** ``ImportError`` where Gymnasium is not installed.
    """
    _require(environment)
    count = whole_number("num_envs", num_envs, 1)
    from .gymnasium_classes import JaxballVectorEnv

    return JaxballVectorEnv(environment, count)


def _require(environment: Environment) -> None:
    require("environment", environment, Environment, "an Environment")
    if importlib.util.find_spec("gymnasium") is None:
        raise ImportError(f"The adapter needs gymnasium, which is not installed; {pip_install('environments')}.")


class BraxState(Printed):
    """The state of an environment in the form of Brax, with the same fields.

    - ``pipeline_state``: the :class:`Episode`.
    - ``obs``: the observation, shape (numbers,).
    - ``reward``: of the last step.
    - ``done``: 1 where the episode is over, terminated or truncated, else 0.
    - ``metrics``: ``status`` of the step, a :class:`~jaxball.Status` by its number.
    - ``info``: ``truncation``, 1 where the episode is over and has only come to its last step, else 0; and whatever
      wrappers add, which steps keep.
    """

    pipeline_state: Episode
    obs: Float[Array, " numbers"]
    reward: Float[Array, ""]
    done: Float[Array, ""]
    metrics: dict[str, Array]
    info: dict[str, Any]

    def replace(self, **changes: Any) -> "BraxState":
        """Returns the state with other values of some fields."""
        return dataclasses.replace(self, **changes)


class BraxEnvironment(Printed):
    """An environment with the methods that wrappers and training loops of Brax call.

    Episodes are not reset by themselves; Brax has wrappers for that. Their ``episode_length`` counts in addition to the
    ``samples`` of the environment.

    **Arguments:**

    - ``environment``: the :class:`Environment`.

    **Example:**

    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> import jaxball
    >>> from jaxball.environments import BraxEnvironment, Environment, ReachPoint
    >>> pendulum = jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Motor(0.0, limit=1.0))
    >>> robot = jaxball.Disk(mass=1.0, inertia=0.5, mechanisms=[pendulum])
    >>> like_brax = BraxEnvironment(Environment(robot, ReachPoint(2.0), sample=0.1))
    >>> state = like_brax.reset(jax.random.PRNGKey(0))
    >>> state = jaxball.jit(like_brax.step)(state, jax.numpy.array([0.5]))
    >>> state.obs.shape, float(state.done)
    ((12,), 0.0)
    """

    environment: Environment

    def __check_init__(self):
        require("environment", self.environment, Environment, "an Environment")

    def reset(self, rng: Any) -> BraxState:
        """Returns the state at the beginning of an episode, from a random key."""
        episode, observation = self.environment.reset(rng)
        # Zeros of one type from the start, because Brax scans over these states, whose types must not change.
        zero = jnp.zeros((), observation.dtype)
        return BraxState(episode, observation, zero, zero, {"status": zero}, {"truncation": zero})

    def step(self, state: BraxState, action: Float[Array, " m"]) -> BraxState:
        """Returns the state after a step."""
        after = self.environment.step(state.pipeline_state, action)
        of = state.reward.dtype
        done, truncation = (after.terminated | after.truncated).astype(of), after.truncated.astype(of)
        metrics = state.metrics | {"status": after.info["status"].astype(of)}
        info = state.info | {"truncation": truncation}
        return BraxState(after.episode, after.observation, after.reward, done, metrics, info)

    @property
    def observation_size(self) -> int:
        """How many numbers a policy observes."""
        return self.environment.n_observations

    @property
    def action_size(self) -> int:
        """The number of inputs."""
        return self.environment.n_actions

    @property
    def backend(self) -> str:
        """What simulates."""
        return "jaxball"

    @property
    def unwrapped(self) -> "BraxEnvironment":
        """The environment itself."""
        return self
