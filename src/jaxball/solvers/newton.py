"""Simplified Newton iteration for the stages: one Jacobian a step, and small systems in place of a large one."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .iteration import iterate
from .linear import factorise
from .stages import FROM_CONTROLLER, AbstractStageIteration, StageEquations, Stages, combine


class SimplifiedNewton(AbstractStageIteration):
    """For stiff problems, and for any with a mass matrix.

    With the Jacobian h∂g/∂x of the start of the step in the place of those of the stages, their s·n
    equations fall apart into the modes of A⁻¹: (λM − h∂g/∂x) ΔW = …, a complex system of n equations
    for each pair of conjugate eigenvalues λ and one for the real eigenvalue (Hairer & Wanner 1996,
    section IV.8, eq. (8.5)).

    **Arguments:**

    - ``kappa``: the iteration ends when the error that remains is this fraction of the tolerance.
    - ``max_steps``: iterations after which the step is given up, to be tried again half as long.
    - ``rtol``, ``atol``, ``norm``: those of the step-size controller unless given.
    """

    kappa: float = 1e-2
    max_steps: int = 15
    rtol: Any = FROM_CONTROLLER
    atol: Any = FROM_CONTROLLER
    norm: Any = FROM_CONTROLLER

    def solve(self, equations: StageEquations, guess: Float[Array, "s n"], rate: Float[Array, ""]) -> Stages:
        Z, (converged, rate, smooth, f0) = jax.lax.custom_root(
            equations.residual,
            equations.increments(guess),
            lambda _, Z: self._iterate(equations, Z, rate),
            lambda linear, y: _solve_exactly(equations, linear, y),
            has_aux=True,
        )
        K = combine(equations.tableau.A_inverse, Z)
        return Stages(Z, K, converged, rate, smooth, f0)

    def _iterate(self, equations: StageEquations, Z: Float[Array, "s n"], rate: Float[Array, ""]):
        tableau, x0 = equations.tableau, equations.x0
        f0, J = _value_and_jacobian(lambda x: equations.slope(equations.t0, x), x0)
        M = jnp.eye(x0.size, dtype=x0.dtype) if equations.mass is None else equations.mass.matrix
        modes = jnp.asarray(tableau.eigenvalues, dtype=np.result_type(x0.dtype, np.complex64))
        solve = factorise(modes[:, None, None] * M - J)
        weights = tableau.eigenvalues[:, None] * tableau.to_modes

        def update(Z):
            change = combine(tableau.from_modes, solve(combine(weights, -equations.residual(Z)))).real
            return Z + change, self.size(equations, change)

        end = iterate(
            update, Z, rate, limit=self.kappa, floor=self.rounding(equations), max_steps=self.max_steps
        )
        smooth = solve.inverses[0].real if tableau.eigenvalues[0].imag == 0 else None
        return end.x, (end.converged, end.rate, smooth, f0)


def _value_and_jacobian(f: Callable, x: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """f(x) and ∂f/∂x by forward mode, in one pass."""
    basis = jnp.eye(x.size, dtype=x.dtype)
    value, columns = jax.vmap(lambda v: jax.jvp(f, (x,), (v,)), out_axes=(None, 1))(basis)
    return value, columns


def _solve_exactly(equations: StageEquations, linear: Callable, y: Float[Array, "s n"]) -> Float[Array, "s n"]:
    """Solves ``linear(Z) = y``, where ``linear`` is M Z − A (h∂g/∂x) Z with the Jacobian of each stage its own.

    A vector that is the same in all stages shows one column of all the Jacobians at once, so that n
    products are enough for the matrix of s·n equations.
    """
    tableau, (s, n) = equations.tableau, y.shape
    M = jnp.eye(n, dtype=y.dtype) if equations.mass is None else equations.mass.matrix
    probes = jnp.broadcast_to(jnp.eye(n, dtype=y.dtype)[:, None], (n, s, n))
    answers = jax.vmap(lambda V: combine(tableau.A_inverse, equations.mass_times(V) - linear(V)))(probes)
    J = jnp.transpose(answers, (1, 2, 0))
    A = jnp.asarray(tableau.A, dtype=y.dtype)
    eye = jnp.eye(s, dtype=y.dtype)
    matrix = jnp.einsum("ij,ab->iajb", eye, M) - jnp.einsum("ij,jab->iajb", A, J)
    return jnp.linalg.solve(matrix.reshape(s * n, s * n), y.reshape(s * n)).reshape(s, n)
