"""Simplified Newton iteration for the stages: one Jacobian per step, and small systems in place of a large one."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..numerics.linear import complex_inverses, inverses, solutions
from .iteration import iterate
from .stages import FROM_CONTROLLER, AbstractStageIteration, Memory, StageEquations, Stages, combine
from .tableau import Tableau


class SimplifiedNewton(AbstractStageIteration):
    """For stiff problems, and for any with a mass matrix.

    With the Jacobian h∂g/∂x at the start of the step in place of those of the stages, their s·n equations decouple into
    the modes of A⁻¹: (λM − h∂g/∂x) ΔW = …, a complex system of n equations for each pair of conjugate eigenvalues λ and
    one for the real eigenvalue (Hairer & Wanner 1996, section IV.8, eq. (8.5)).

    **Arguments:**

    - ``kappa``: the iteration ends when the remaining error is this fraction of the tolerance.
    - ``max_steps``: the most iterations before the step is retried with half the length.
    - ``rtol``, ``atol``, ``norm``: by default those of the step-size controller.
    - ``reuse``: the matrices of the last step are reused while the step length relative to theirs is between this and
      its inverse, and the iteration converges well with them; 1 recomputes them at every step. By default it is 0.8
      with the tolerances of a step-size controller, which shortens a step whose iteration fails, and 1 with explicit
      tolerances, as needed for steps of constant length, where a failure would end the solve.
    - ``slowest``: matrices with which an iteration reduced the error by less than this factor are not reused.
    """

    kappa: float
    max_steps: int
    rtol: Any
    atol: Any
    norm: Any
    reuse: float
    slowest: float

    def __init__(
        self,
        kappa: float = 1e-2,
        max_steps: int = 15,
        rtol: Any = FROM_CONTROLLER,
        atol: Any = FROM_CONTROLLER,
        norm: Any = FROM_CONTROLLER,
        reuse: float | None = None,
        slowest: float = 0.1,
    ):
        self.kappa, self.max_steps = kappa, max_steps
        self.rtol, self.atol, self.norm = rtol, atol, norm
        self.reuse = (0.8 if rtol is FROM_CONTROLLER else 1.0) if reuse is None else reuse
        self.slowest = slowest

    def start(self, tableau: Tableau, x0: Float[Array, " n"]) -> Memory:
        zero = jnp.zeros((len(tableau.modes.eigenvalues), x0.size, x0.size), x0.dtype)
        imaginary = zero if np.any(np.imag(tableau.eigenvalues)) else None
        return Memory(jnp.ones((), x0.dtype), zero, imaginary, jnp.ones((), x0.dtype))

    def iterate(self, equations: StageEquations, guess: Float[Array, "s n"], memory: Memory) -> Stages:
        tableau, modes = equations.tableau, equations.tableau.modes
        made = self._matrices(equations, memory)

        def update(Z):
            right = combine(modes.weighted, -equations.residual(Z))
            change = solutions(made.inverses, right)
            if made.imaginary is not None:
                partners = jnp.stack([right[place] for place in modes.partner.tolist()])
                change = change + solutions(made.imaginary, partners)
            change = combine(modes.to_stages, change)
            return Z + change, self.size(equations, change)

        end = iterate(
            update,
            equations.right_side(guess),
            memory.rate,
            limit=self.kappa,
            floor=self.rounding(equations),
            max_steps=self.max_steps,
        )
        K = combine(tableau.A_inverse, equations.without_known(end.x))
        smooth = made.inverses[0] if tableau.eigenvalues[0].imag == 0 else None
        memory = Memory(end.rate, made.inverses, made.imaginary, made.control)
        return Stages(end.x, K, end.converged, made.singular, memory, smooth, made.f0)

    def _matrices(self, equations: StageEquations, memory: Memory) -> "_Matrices":
        """The matrices of the step before, if these are good enough, or new ones."""
        tableau, x0 = equations.tableau, equations.x0
        control, remembered, made_for = equations.control.astype(x0.dtype), memory.inverses, memory.control
        imaginary, eigenvalues = memory.imaginary, tableau.modes.eigenvalues
        assert remembered is not None
        assert made_for is not None

        def renew():
            f0, J = value_and_jacobian(lambda x: equations.slope(equations.t0, x), x0)
            M = equations.mass_matrix()[None]
            real, other = (
                jnp.asarray(x, x0.dtype)[:, None, None] * M for x in (np.real(eigenvalues), np.imag(eigenvalues))
            )
            if imaginary is None:
                new, other = inverses(real - J[None]), None
            else:
                new, other = complex_inverses(real - J[None], other)
            singular = jnp.all(jnp.isfinite(J)) & ~jnp.all(jnp.isfinite(new))
            return _Matrices(new, other, control, None if equations.f0 is None else f0, singular)

        def keep():
            return _Matrices(remembered, imaginary, made_for, equations.f0, jnp.asarray(False))

        if self.reuse >= 1:
            return renew()
        ratio = control / made_for
        near = (ratio * self.reuse < 1) & (ratio > self.reuse)
        return jax.lax.cond(near & (memory.rate < self.slowest), keep, renew)

    def tangents(self, equations, stages, changes):
        """One linear system of s·n equations with a separate Jacobian for each stage, solved exactly."""
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


class _Matrices(NamedTuple):
    """The parts of (λM − h∂g/∂x)⁻¹ for the modes, its step length h, h g(t₀, x₀), and whether one is singular."""

    inverses: Float[Array, "k n n"]
    imaginary: Float[Array, "k n n"] | None
    control: Float[Array, ""]
    f0: Float[Array, " n"] | None
    singular: Bool[Array, ""]


def value_and_jacobian(f: Callable, x: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"]]:
    """f(x) and ∂f/∂x by forward mode, with what does not depend on the direction computed once."""
    value, tangent = jax.linearize(f, x)
    return value, jax.vmap(tangent, out_axes=1)(jnp.eye(x.size, dtype=x.dtype))
