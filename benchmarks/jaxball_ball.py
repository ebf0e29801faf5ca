"""The paper's ball in jaxball, by the default settings: as a user types it, and as a compiled solve alone."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from harness import timed

import jaxball
from jaxball import BallState, paper, simulate

TIMES = (paper.START, paper.END)
TOLERANCES = (1e-8, 1e-9, 1e-10, 1e-11)


def typed() -> Callable[[], np.ndarray]:
    """``simulate(ball, times)``, with every default, called from Python."""
    ball = paper.ball()
    return lambda: np.asarray(final(simulate(ball, TIMES).state, np))


def compiled(jit: Callable = jaxball.jit) -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, the same solve within a user's own jit of the ball and the tolerance."""

    def run(ball, tolerance):
        return final(simulate(ball, TIMES, rtol=tolerance, atol=tolerance).state, jnp)

    solve = jit(run)
    ball = paper.ball()
    tolerances = {tolerance: jnp.asarray(tolerance) for tolerance in TOLERANCES}
    return {name: lambda tolerance=array: np.asarray(solve(ball, tolerance)) for name, array in tolerances.items()}


def final(state: BallState, xp):
    """(q, Ω, z) at the last time, in NumPy or JAX; NumPy waits for the solve."""
    return xp.concatenate([xp.asarray(part)[-1] for part in (state.q, state.Omega, state.z)])


def compile_time(call: Callable) -> float:
    """Seconds that the first call takes longer than the second."""
    return timed(call)[0] - timed(call)[0]
