"""Fixed-point iteration for the stages, which needs neither Jacobians nor linear systems."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .iteration import iterate
from .stages import FROM_CONTROLLER, AbstractStageIteration, Memory, StageEquations, Stages, combine
from .tableau import Tableau

LONGEST_SERIES = 100


class FixedPoint(AbstractStageIteration):
    """For problems that are not stiff: K ← h f(tᵢ, x₀ + A K), all stages at once.

    It converges if h‖∂f/∂x‖ ‖A‖ < 1, the faster the more stages there are, because A integrates.

    **Arguments:**

    - ``kappa``: the iteration ends when the remaining error is this fraction of the tolerance.
    - ``max_steps``: the most iterations before the step is retried with half the length.
    - ``rtol``, ``atol``, ``norm``: by default those of the step-size controller.

    **Raises:** ``TypeError`` for a problem with a mass matrix.
    """

    kappa: float = 1e-4
    max_steps: int = 25
    rtol: Any = FROM_CONTROLLER
    atol: Any = FROM_CONTROLLER
    norm: Any = FROM_CONTROLLER

    def start(self, tableau: Tableau, x0: Float[Array, " n"]) -> Memory:
        return Memory(jnp.ones((), x0.dtype))

    def iterate(self, equations: StageEquations, guess: Float[Array, "s n"], memory: Memory) -> Stages:
        if equations.mass is not None:
            raise TypeError(
                "Argument `root_finder` must be a SimplifiedNewton where there is a mass matrix, "
                "but it is a FixedPoint."
            )

        def update(K):
            new = equations.slopes(equations.right_side(K))
            return new, self.size(equations, new - K)

        end = iterate(
            update, guess, memory.rate, limit=self.kappa, floor=self.rounding(equations), max_steps=self.max_steps
        )
        Z = equations.right_side(end.x)
        return Stages(Z, end.x, end.converged, jnp.asarray(False), Memory(end.rate))

    def tangents(self, equations, stages, changes):
        """The tangents of the iteration's limit, K = slopes(A K), by the same iteration, to rounding."""
        _, change = eqx.filter_jvp(lambda e: e.slopes(e.right_side(stages.K)), (equations,), (changes,))
        _, slopes = jax.linearize(equations.slopes, stages.Z)
        A = equations.tableau.A
        K = jax.lax.custom_linear_solve(lambda K: K - slopes(combine(A, K)), change, _series, transpose_solve=_series)
        return changes.with_known(combine(A, K)), K


def _series(linear, y: Float[Array, "s n"]) -> Float[Array, "s n"]:
    def unfinished(carry):
        x, change, count = carry
        return (jnp.max(jnp.abs(change)) > jnp.finfo(y.dtype).eps * jnp.max(jnp.abs(x))) & (count < LONGEST_SERIES)

    def add(carry):
        x, _, count = carry
        change = y - linear(x)
        return x + change, change, count + 1

    return jax.lax.while_loop(unfinished, add, (y, y, 0))[0]
