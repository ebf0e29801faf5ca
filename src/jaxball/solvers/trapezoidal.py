"""The trapezoidal rule."""

from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from .base import AbstractStageSolver
from .diagonal import diagonally_implicit, first_slope
from .errors import smoothed
from .flat import flat_problem
from .interpolation import CubicHermite
from .newton import SimplifiedNewton
from .outcome import outcome
from .stages import AbstractStageIteration, Memory, StageEquations

TABLEAU = diagonally_implicit([1.0], [[0.5]])


class TrapezoidalState(NamedTuple):
    """The step before this one: its length, f at its start and end, and whether there was one."""

    length: Float[Array, ""]
    f_start: Float[Array, " n"]
    f_end: Float[Array, " n"]
    memory: Memory
    known: Bool[Array, ""]


class Trapezoidal(AbstractStageSolver):
    """The trapezoidal rule, y₁ = y₀ + h/2 (f₀ + f₁), as in MATLAB's ode23t.

    Order 2, A-stable and not L-stable: it damps nothing that the problem does not damp, and stiff
    components that the steps do not resolve alternate for a long time. For low accuracy.

    The error h³y‴/12 is taken from the second divided difference of f over this step and the one before
    (Shampine, Reichelt & Kierzenka 1999). On a first step and after a jump there is none before, and the
    distance to Euler's rule stands for it, which is too large and makes the step short.

    **Arguments:**

    - ``root_finder``: :class:`~jaxball.solvers.SimplifiedNewton` or :class:`~jaxball.solvers.FixedPoint`.
    """

    interpolation_cls: ClassVar = CubicHermite

    root_finder: AbstractStageIteration = SimplifiedNewton()

    def order(self, terms) -> int:
        return 2

    def error_order(self, terms) -> int:
        return 3

    def init(self, terms, t0: Any, t1: Any, y0, args) -> TrapezoidalState:
        x0, _ = ravel_pytree(y0)
        nothing, memory = jnp.zeros_like(x0), self.root_finder.start(TABLEAU, x0)
        return TrapezoidalState(jnp.ones((), x0.dtype), nothing, nothing, memory, jnp.asarray(False))

    def step(self, terms, t0: Any, t1: Any, y0, args, solver_state, made_jump: Any):
        problem = flat_problem(terms, t0, t1, y0, args)
        problem.refuse_mass(self)
        x0, unravel, slope = problem.x0, problem.unravel, problem.slope
        h, past = problem.control.astype(x0.dtype), solver_state
        has_past = past.known & ~jnp.asarray(made_jump)
        k0 = first_slope(problem, t0, has_past, past.f_end)
        equations = StageEquations(TABLEAU, slope, t0, t1[None], x0, problem.control, unravel, known=k0[None] / 2)
        stages = self.root_finder.solve(equations, k0[None], past.memory.forgotten(made_jump))
        k1 = stages.K[0]
        error = jnp.where(has_past, _error(h, past.length, past.f_start, k0, k1), (k1 - k0) / 2)
        y_error, result = outcome(stages, smoothed(equations, stages, error), t0, t1)
        state = TrapezoidalState(h, k0 / h, k1 / h, jax.lax.stop_gradient(stages.memory), jnp.asarray(True))
        y1 = unravel(x0 + stages.Z[0])
        dense = {"y0": y0, "y1": y1, "k0": unravel(k0), "k1": unravel(k1)}
        return y1, unravel(y_error), dense, state, result


def _error(h, before, f, k0, k1):
    """h³/12 times the second derivative of f, from f at three times; k₀ = h f₀, k₁ = h f₁."""
    return h / (6 * (h + before)) * (k1 - k0 - (k0 - h * f) * h / before)
