"""The paper's ball in jaxball, by the default settings: as a user types it, and as a compiled solve alone."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from harness import timed
from jax.flatten_util import ravel_pytree

import jaxball
from jaxball import BallState, paper, simulate
from jaxball.paper.reproduce.experiments import Counter, CountingSolver
from jaxball.paper.systems import PAPER_END, PAPER_START

TIMES = (PAPER_START, PAPER_END)
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


def evaluations(solver: Any, *run: Any, **settings: Any) -> int:
    """How often ``simulate`` of a run evaluates the right-hand side."""
    counter = Counter()
    simulate(*run, solver=CountingSolver(solver, counter), throw=True, **settings)
    return counter.read()


def loop(count: int, function: Callable, *parts: Any) -> Callable:
    """A compiled loop that does nothing but evaluate a function of t and of ``parts`` at so many t from 0 to 20."""

    @jax.jit
    def run(parts):
        numbers, unpack = ravel_pytree(parts)

        def at(t):
            return ravel_pytree(function(t, *unpack(numbers)))[0]

        return jax.lax.fori_loop(0, count, lambda k, total: total + at(20 * k / count), at(jnp.asarray(0.0)))

    return lambda: jax.block_until_ready(run(parts))
