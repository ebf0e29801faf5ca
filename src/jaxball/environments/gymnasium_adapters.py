"""Adapters to Gymnasium: one environment, and many side by side."""

import importlib.util
from typing import TYPE_CHECKING

from ..control.loop import whole_number
from ..interface.arguments import require
from ..interface.wording import pip_install
from .environment import Environment

if TYPE_CHECKING:
    import gymnasium


def gymnasium_env(environment: Environment) -> "gymnasium.Env":
    """The environment as a ``gymnasium.Env``.

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
    """Many of the environment side by side as a ``gymnasium.vector.VectorEnv``, compiled as one program.

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
