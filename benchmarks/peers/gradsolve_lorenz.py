"""Lorenz' equations in GRADSOLVE, by the kernels that it chooses itself."""

import gradsolve
import harness
import jax
import jax.numpy as jnp
import numpy as np
from gpu_timings import picked, timings

from peers.diffrax_lorenz import right_hand_side

REPEATS = 5


class Lorenz:
    """The problem as GRADSOLVE knows it; with this name it has kernels for it."""

    name = "diffeqgpu_lorenz"
    dim = 3
    t0, t1 = 0.0, 1.0
    is_stiff = False

    def f_jax(self, t, y, p):
        return right_hand_side(t, y, p[0])


def lorenz(rows: int, tolerance: float) -> dict:
    """As ``gpu_timings.lorenz``, with copies from and to the host."""
    y0, rho, settings = _given(rows, tolerance)

    def call():
        return gradsolve.solve(Lorenz(), y0, rho[:, None], **settings)

    first, result = harness.timed(call)
    seconds = min(harness.timed(call)[0] for _ in range(REPEATS))
    answer = {"compiler": result.solver, "compile": None, "first": first, "seconds": seconds, "calls": REPEATS}
    return {**answer, "rows": rows, "states": picked(result.y_final), "initial": picked(rho)}


def lorenz_gradient(rows: int, tolerance: float) -> dict:
    """As ``gpu_timings.lorenz_gradient``, without the run that records the steps."""
    y0, rho, settings = _given(rows, tolerance)
    ends = gradsolve.grad_closure(Lorenz(), y0, rho[:, None], **settings)
    found, slopes = timings(jax.jit(jax.grad(lambda p: jnp.sum(ends(p) ** 2))), jnp.asarray(rho[:, None]))
    who = {"compiler": ends.route.actual, "rows": rows}
    return {**found, **who, "states": picked(slopes[:, 0]), "initial": picked(rho)}


def _given(rows: int, tolerance: float) -> tuple[np.ndarray, np.ndarray, dict]:
    device = "cpu" if jax.default_backend() == "cpu" else "cuda"
    settings = {"rtol": tolerance, "atol": 1e-3 * tolerance, "device": device}
    return np.tile([1.0, 0.0, 0.0], (rows, 1)), np.linspace(0.0, 21.0, rows), settings
