"""Lorenz' equations in diffrax, as one writes them who knows JAX: ``jax.vmap`` of ``diffrax.diffeqsolve``."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from gpu_timings import picked, timings

MOST_STEPS = 512


def lorenz(rows: int, tolerance: float) -> dict:
    """As ``gpu_timings.lorenz``."""
    return _timed(lambda rho: end(rho, tolerance), rows)


def lorenz_gradient(rows: int, tolerance: float) -> dict:
    """As ``gpu_timings.lorenz_gradient``."""
    return _timed(jax.grad(lambda rho: jnp.sum(end(rho, tolerance) ** 2)), rows)


def end(rho, tolerance: float):
    """y(1)."""
    return diffrax.diffeqsolve(
        diffrax.ODETerm(right_hand_side),
        diffrax.Tsit5(),
        0.0,
        1.0,
        None,
        jnp.array([1.0, 0.0, 0.0]),
        args=rho,
        stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=1e-3 * tolerance),
        max_steps=MOST_STEPS,
    ).ys[-1]


def right_hand_side(t, y, rho):
    """With σ = 10 and β = 8/3."""
    return jnp.stack([10.0 * (y[1] - y[0]), y[0] * (rho - y[2]) - y[1], y[0] * y[1] - 8.0 / 3.0 * y[2]])


def _timed(function, rows: int) -> dict:
    rho = np.linspace(0.0, 21.0, rows)
    found, result = timings(jax.jit(jax.vmap(function)), jnp.asarray(rho))
    return {**found, "rows": rows, "states": picked(result), "initial": picked(rho)}
