"""Fixed-point iteration for the stages, which needs neither Jacobians nor linear systems."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .iteration import iterate
from .stages import FROM_CONTROLLER, AbstractStageIteration, StageEquations, Stages


LONGEST_SERIES = 100


class FixedPoint(AbstractStageIteration):
    """For problems that are not stiff: K ← h f(tᵢ, x₀ + A K), all stages at once.

    It converges where h‖∂f/∂x‖ ‖A‖ < 1, and the faster the more stages there are, because A integrates.

    **Arguments:**

    - ``kappa``: the iteration ends when the error that remains is this fraction of the tolerance.
    - ``max_steps``: iterations after which the step is given up, to be tried again half as long.
    - ``rtol``, ``atol``, ``norm``: those of the step-size controller unless given.

    **Raises:** ``TypeError`` for a problem with a mass matrix.
    """

    kappa: float = 1e-3
    max_steps: int = 25
    rtol: Any = FROM_CONTROLLER
    atol: Any = FROM_CONTROLLER
    norm: Any = FROM_CONTROLLER

    def solve(self, equations: StageEquations, guess: Float[Array, "s n"], rate: Float[Array, ""]) -> Stages:
        if equations.mass is not None:
            raise TypeError(
                "Argument `root_finder` must be a SimplifiedNewton for a problem with a mass matrix, but it is a FixedPoint."
            )
        K, (converged, rate) = jax.lax.custom_root(
            lambda K: K - equations.slopes(equations.increments(K)),
            guess,
            lambda _, K: self._iterate(equations, K, rate),
            _solve_linear,
            has_aux=True,
        )
        return Stages(equations.increments(K), K, converged, rate, None, None)

    def _iterate(self, equations: StageEquations, K: Float[Array, "s n"], rate: Float[Array, ""]):
        def update(K):
            new = equations.slopes(equations.increments(K))
            return new, self.size(equations, new - K)

        end = iterate(
            update, K, rate, limit=self.kappa, floor=self.rounding(equations), max_steps=self.max_steps
        )
        return end.x, (end.converged, end.rate)


def _solve_linear(linear, y: Float[Array, "s n"]) -> Float[Array, "s n"]:
    """Solves ``linear(K) = y``, where ``linear`` is K − h∂f/∂x A K, by the same iteration, to rounding."""
    return jax.lax.custom_linear_solve(linear, y, _series, transpose_solve=_series)


def _series(linear, y: Float[Array, "s n"]) -> Float[Array, "s n"]:
    def unfinished(carry):
        x, change, count = carry
        return (jnp.max(jnp.abs(change)) > jnp.finfo(y.dtype).eps * jnp.max(jnp.abs(x))) & (count < LONGEST_SERIES)

    def add(carry):
        x, _, count = carry
        change = y - linear(x)
        return x + change, change, count + 1

    return jax.lax.while_loop(unfinished, add, (y, y, 0))[0]
