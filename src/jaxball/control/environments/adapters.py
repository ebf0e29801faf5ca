"""Adapters to what libraries of reinforcement learning take: environments of Gymnasium, and the interface of Brax."""

import dataclasses
import importlib.util
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...interface.arguments import whole_number
from ...interface.printing import Printed
from ...interface.wording import pip_install
from .environment import Environment, Episode

if TYPE_CHECKING:
    import gymnasium


def gymnasium_env(environment: Environment) -> "gymnasium.Env":
    _require_gymnasium()
    from .gymnasium_classes import JaxballEnv

    return JaxballEnv(environment)


def gymnasium_vector_env(environment: Environment, num_envs: int) -> "gymnasium.vector.VectorEnv":
    _require_gymnasium()
    count = whole_number("num_envs", num_envs, 1)
    from .gymnasium_classes import JaxballVectorEnv

    return JaxballVectorEnv(environment, count)


def _require_gymnasium() -> None:
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
    """

    environment: Environment

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
