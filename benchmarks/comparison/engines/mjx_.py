"""MJX, MuJoCo in JAX: the place where a robot ends, and its derivative, by forward mode through all steps."""

import importlib
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .contract import Derivative, time_calls

# Untyped, because they need not be installed where types are checked.
mujoco: Any = importlib.import_module("mujoco")
mjx: Any = importlib.import_module("mujoco.mjx")
REPEATS = 3


def derivatives(models: list[tuple[Any, np.ndarray]]) -> list[Derivative]:
    """The derivative of the final place along its controls, for each model with those of each step.

    One program is compiled for all of them, in the first call; its solver stops when it is accurate, by a loop that
    JAX cannot differentiate in reverse mode.
    """
    longest = max(len(controls) for _, controls in models)
    program = jax.jit(_final)
    found = []
    for model, controls in models:
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        padded = np.zeros((longest, model.nu))
        padded[: len(controls)] = controls
        given = mjx.put_model(model), mjx.put_data(model, data), jnp.asarray(padded), jnp.asarray(len(controls))
        value, calls = time_calls(lambda given=given: program(*given), REPEATS)
        compiling = calls[0] - min(calls) if not found else 0.0
        found.append(Derivative(value, compiling, min(calls)))
    return found


def _final(model: Any, data: Any, controls: Any, steps: Any) -> Any:
    def place(scale: Any) -> Any:
        def step(index: Any, now: Any) -> Any:
            after = mjx.step(model, now.replace(ctrl=scale * controls[index]))
            return jax.tree.map(lambda old, new: new.astype(old.dtype), now, after)

        return jax.lax.fori_loop(0, steps, step, data).qpos[:2]

    one = jnp.ones(())
    return jax.jvp(place, (one,), (one,))[1]
