"""The classes that ``adapters`` returns for Gymnasium; this module is imported only where Gymnasium is installed."""

from typing import Any

import gymnasium
import jax
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from ...programs.batches import in_lanes
from ...programs.users_functions import jit
from .environment import Environment, Transition

SEEDS = 2**31  # of random keys that Gymnasium's generator gives


class JaxballEnv(gymnasium.Env):
    """One environment; see :meth:`Environment.gymnasium`."""

    metadata = {"render_modes": []}  # noqa: RUF012 (as Gymnasium declares it)

    def __init__(self, environment: Environment):
        self.environment = environment
        self.observation_space, self.action_space = _spaces(environment)
        self._reset: Any = jit(environment.reset)
        self._step: Any = jit(environment.step)
        self._episode: Any = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        # From Gymnasium's own generator, so that later resets without a seed follow from the first.
        self._episode, seen = self._reset(jax.random.key(int(self.np_random.integers(SEEDS))))
        return _observation(seen), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        if self._episode is None:
            raise RuntimeError("Method `step` needs an episode; call reset() first.")
        after = self._step(self._episode, np.asarray(action, float))
        self._episode = after.episode
        # Copies: what shares its memory with arrays of JAX is read-only.
        info = {name: np.array(value) for name, value in after.info.items()}
        return (
            _observation(after.observation),
            float(after.reward),
            bool(after.terminated),
            bool(after.truncated),
            info,
        )


class JaxballVectorEnv(VectorEnv):
    """Many environments; see :meth:`Environment.gymnasium_vector`."""

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012 (as Gymnasium declares it)

    def __init__(self, environment: Environment, num_envs: int):
        self.environment, self.num_envs = environment, num_envs
        self.single_observation_space, self.single_action_space = _spaces(environment)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._reset, self._step = jit(in_lanes(environment.reset)), jit(in_lanes(environment.step_or_reset))
        self._episodes: Any = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        key = jax.random.key(int(self.np_random.integers(SEEDS)))
        self._episodes, seen = self._reset(jax.random.split(key, self.num_envs))
        return _observation(seen), {}

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        if self._episodes is None:
            raise RuntimeError("Method `step` needs episodes; call reset() first.")
        after: Transition = self._step(self._episodes, np.asarray(actions, float))
        self._episodes = after.episode
        terminated, truncated = np.array(after.terminated), np.array(after.truncated)
        return (
            _observation(after.observation),
            np.array(after.reward),
            terminated,
            truncated,
            _infos(after.info, terminated | truncated),
        )


def _infos(info: dict[str, Any], over: np.ndarray) -> dict[str, Any]:
    """Converts infos to the form of Gymnasium: each entry with a mask of the episodes that have it, and the last
    observation of episodes that are over.
    """
    infos: dict[str, Any] = {name: np.array(value) for name, value in info.items()}
    final = _observation(infos.pop("final_observation"))
    everyone = np.ones(over.shape, bool)
    infos |= {f"_{name}": everyone for name in list(infos)}
    # Gymnasium has these entries only in steps after which an episode is over.
    if np.any(over):
        infos |= {"final_obs": final, "_final_obs": over}
    return infos


def _spaces(environment: Environment) -> tuple[Box, Box]:
    observed = Box(-np.inf, np.inf, (environment.n_observations,), np.float32)
    return observed, Box(-1.0, 1.0, (environment.n_actions,), np.float32)


def _observation(seen: Any) -> np.ndarray:
    return np.asarray(seen).astype(np.float32)
