"""Simplified Newton iteration for the stages: one Jacobian a step, and small systems in place of a large one."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

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

    def iterate(self, equations: StageEquations, guess: Float[Array, "s n"], rate: Float[Array, ""]) -> Stages:
        tableau, x0 = equations.tableau, equations.x0
        f0, J = value_and_jacobian(lambda x: equations.slope(equations.t0, x), x0)
        modes = tableau.eigenvalues
        modes = jnp.asarray(modes, np.result_type(x0.dtype, np.complex64) if np.iscomplexobj(modes) else x0.dtype)
        M = equations.mass_matrix().astype(modes.dtype)
        solve = factorise(modes[:, None, None] * M[None] - J[None].astype(modes.dtype))
        weights = tableau.eigenvalues[:, None] * tableau.to_modes

        def update(Z):
            change = combine(tableau.from_modes, solve(combine(weights, -equations.residual(Z)))).real
            return Z + change, self.size(equations, change)

        end = iterate(
            update,
            equations.right_side(guess),
            rate,
            limit=self.kappa,
            floor=self.rounding(equations),
            max_steps=self.max_steps,
        )
        K = combine(tableau.A_inverse, equations.without_known(end.x))
        smooth = solve.inverses[0].real if tableau.eigenvalues[0].imag == 0 else None
        singular = jnp.all(jnp.isfinite(J)) & ~jnp.all(jnp.isfinite(solve.inverses))
        return Stages(end.x, K, end.converged, end.rate, singular, smooth, f0)

    def tangents(self, equations, stages, changes):
        """One linear system of s·n equations with the Jacobian of each stage its own, solved exactly."""
        tableau, (s, n) = equations.tableau, stages.Z.shape
        _, residual = eqx.filter_jvp(lambda e: e.residual(stages.Z), (equations,), (changes,))
        J = jax.vmap(lambda t, x: value_and_jacobian(lambda x: equations.slope(t, x), x)[1])(
            equations.times, equations.x0[None] + stages.Z
        )
        A, eye = jnp.asarray(tableau.A, dtype=J.dtype), jnp.eye(s, dtype=J.dtype)
        matrix = eye[:, None, :, None] * equations.mass_matrix()[None, :, None, :]
        matrix = matrix - A[:, None, :, None] * jnp.transpose(J, (1, 0, 2))[None]
        Z = jnp.linalg.solve(matrix.reshape(s * n, s * n), -residual.reshape(s * n)).reshape(s, n)
        return Z, combine(tableau.A_inverse, changes.without_known(Z))


def value_and_jacobian(f: Callable, x: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """f(x) and ∂f/∂x by forward mode, with what does not depend on the direction computed once."""
    value, tangent = jax.linearize(f, x)
    return value, jax.vmap(tangent, out_axes=1)(jnp.eye(x.size, dtype=x.dtype))
