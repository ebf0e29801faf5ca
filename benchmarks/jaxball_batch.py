"""Perturbed copies of the paper's ball in jaxball: as an ensemble, and as ``jax.vmap`` of one run."""

import jax
import jax.numpy as jnp
import numpy as np
from turns import Compiled

from jaxball import BallState, paper, simulate
from jaxball.paper.systems import PAPER_END, PAPER_START
from jaxball.simulation.ensemble import simulate_ensemble

TIMES = (PAPER_START, PAPER_END)


class Ensemble(Compiled):
    """``simulate_ensemble`` with every default."""

    def __init__(self, q: np.ndarray, Omega: np.ndarray, cores: int):
        self.given = paper.ball(), TIMES, at(q, Omega)
        self.threads = cores

    def final(self, tolerance: float) -> np.ndarray:
        ensemble = simulate_ensemble(
            *self.given, rtol=tolerance, atol=tolerance, threads=self.threads, in_axes=(None, 0)
        )
        state = ensemble.trajectory.state
        return np.concatenate([state.q[:, -1], state.Omega[:, -1], state.z[:, -1]], axis=1)


class Vmapped(Compiled):
    """``jax.jit(jax.vmap(simulate))``."""

    def __init__(self, q: np.ndarray, Omega: np.ndarray, cores: int):
        ball = paper.ball()

        def one(q, Omega, tolerance):
            state = simulate(ball, TIMES, BallState(q=q, Omega=Omega), rtol=tolerance, atol=tolerance).state
            return jnp.concatenate([state.q[-1], state.Omega[-1], state.z[-1]])

        self.program = jax.jit(jax.vmap(one, in_axes=(0, 0, None)))
        self.given = jnp.asarray(q), jnp.asarray(Omega)

    def final(self, tolerance: float) -> np.ndarray:
        return np.asarray(self.program(*self.given, jnp.asarray(tolerance)))


def at(q: np.ndarray, Omega: np.ndarray) -> BallState:
    """The states with these q and Ω, z = 0."""
    return jax.tree.map(np.asarray, jax.vmap(lambda q, Omega: BallState(q=q, Omega=Omega))(q, Omega))
