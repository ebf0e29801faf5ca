"""MJX, MuJoCo in JAX: the place where a robot ends, and its derivative, by forward mode through all steps."""

import importlib
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...mjcf import Exported
from .contract import Derivative

# Untyped, because they need not be installed where types are checked.
mujoco: Any = importlib.import_module("mujoco")
mjx: Any = importlib.import_module("mujoco.mjx")
REPEATS = 3


def derivatives(models: list[tuple[Any, Exported, int]], start: float) -> list[Derivative]:
    """The derivative of the final place along its controls, for each model with its controls and number of steps.

    One program is compiled for all of them, in the first call; its solver stops when it is accurate, by a loop that
    JAX cannot differentiate in reverse mode.
    """
    longest = max(steps for _, _, steps in models)
    program = jax.jit(_final)
    found = []
    for model, exported, steps in models:
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        controls = np.zeros((longest, model.nu))
        controls[:steps] = exported.controls_at(start + model.opt.timestep * (np.arange(steps) + 0.5))
        given = mjx.put_model(model), mjx.put_data(model, data), jnp.asarray(controls), jnp.asarray(steps)
        calls = []
        for _ in range(1 + REPEATS):
            begin = time.process_time()
            value = np.asarray(jax.block_until_ready(program(*given)))
            calls.append(time.process_time() - begin)
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
