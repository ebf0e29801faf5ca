"""Methods with an explicit first stage and one coefficient on the diagonal of all others."""

import abc
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from .base import AbstractStageSolver
from .errors import smoothed
from .flat import flat_problem
from .interpolation import CubicHermite
from .newton import SimplifiedNewton
from .outcome import outcome
from .stages import AbstractStageIteration, Memory, combine
from .tableau import Tableau


class StepBefore(NamedTuple):
    """The state after the last step: its length, f at its start and end, and whether there was one."""

    length: Float[Array, ""]
    f_start: Float[Array, " n"]
    f_end: Float[Array, " n"]
    memory: Memory
    known: Bool[Array, ""]


class AbstractDiagonallyImplicit(AbstractStageSolver):
    """A method of order 2 with an error estimate of order 3, whose last stage is the end of the step.

    - ``tableau``: the implicit stages. ``first``: what the explicit first stage contributes to each, shape (s, 1).
    """

    interpolation_cls: ClassVar = CubicHermite
    tableau: ClassVar[Tableau]
    first: ClassVar[np.ndarray]

    root_finder: AbstractStageIteration = SimplifiedNewton()

    @abc.abstractmethod
    def estimated_error(
        self, K: Float[Array, "s_plus_one n"], h: Float[Array, ""], before: StepBefore
    ) -> Float[Array, " n"]:
        """The error of a step of length h, from the slopes of all stages in units of 1/h and the step before."""

    def order(self, terms) -> int:
        return 2

    def error_order(self, terms) -> int:
        return 3

    def init(self, terms, t0: Any, t1: Any, y0, args) -> StepBefore:
        x0, _ = ravel_pytree(y0)
        nothing, memory = jnp.zeros_like(x0), self.root_finder.start(self.tableau, x0)
        return StepBefore(jnp.ones((), x0.dtype), nothing, nothing, memory, jnp.asarray(False))

    def step(self, terms, t0: Any, t1: Any, y0, args, solver_state: StepBefore, made_jump: Any):
        problem = flat_problem(terms, t0, t1, y0, args)
        problem.refuse_mass(self)
        x0, unravel, h = problem.x0, problem.unravel, problem.control.astype(problem.x0.dtype)
        before = solver_state._replace(known=solver_state.known & ~jnp.asarray(made_jump))
        # The last stage of the step before satisfies its equation. Re-evaluated in a stiff problem, f would multiply
        # the error of that stage by the large eigenvalues (Hosea & Shampine 1996, section 4).
        k0 = jax.lax.cond(before.known, lambda: h * before.f_end, lambda: problem.slope(t0, x0))
        times = jnp.stack([*(t0 + float(c) * (t1 - t0) for c in self.tableau.c[:-1]), t1])
        known = combine(self.first, k0[None])
        equations = problem.equations(self.tableau, t0, times, x0, known=known)
        guess = jnp.broadcast_to(k0, known.shape)
        stages = self.root_finder.solve(equations, guess, before.memory.forgotten(made_jump))
        error = self.estimated_error(jnp.concatenate([k0[None], stages.K]), h, before)
        y_error, result = outcome(stages, smoothed(equations, stages, error), t0, t1)
        y1, k1 = unravel(x0 + stages.Z[-1]), stages.K[-1]
        dense = {"y0": y0, "y1": y1, "k0": unravel(k0), "k1": unravel(k1)}
        state = StepBefore(h, k0 / h, k1 / h, jax.lax.stop_gradient(stages.memory), jnp.asarray(True))
        return y1, unravel(y_error), dense, state, result


def diagonally_implicit(c: list[float], A: list[list[float]]) -> Tableau:
    """The tableau of the implicit stages; their ``A`` is lower triangular with one number on the diagonal.

    A⁻¹ then has one eigenvalue and no basis of eigenvectors. Stages serve in place of modes: on a
    linear problem, the iteration is exact after as many passes as there are stages.
    """
    matrix = np.asarray(A)
    identity = np.eye(len(c))
    return Tableau(
        c=np.asarray(c),
        b=matrix[-1],
        A=matrix,
        A_inverse=np.linalg.inv(matrix),
        expansion=identity,
        eigenvalues=1 / matrix[:1, 0],
        to_modes=identity,
        from_modes=identity,
    )
