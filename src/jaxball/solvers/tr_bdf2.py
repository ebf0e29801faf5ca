"""TR-BDF2."""

import math
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from .base import AbstractStageSolver
from .diagonal import diagonally_implicit, first_slope
from .errors import smoothed
from .flat import flat_problem
from .interpolation import CubicHermite
from .newton import SimplifiedNewton
from .outcome import outcome
from .stages import AbstractStageIteration, Memory, StageEquations, combine

GAMMA = 2 - math.sqrt(2)
W, D = math.sqrt(2) / 4, GAMMA / 2
TABLEAU = diagonally_implicit([GAMMA, 1.0], [[D, 0.0], [W, D]])
# What the explicit first stage contributes to the others, and the difference to the embedded formula of order 3.
FIRST = np.array([[D], [W]])
ERROR = np.array([[(4 * W - 1) / 3, -1 / 3, 2 * D / 3]])


class TRBDF2State(NamedTuple):
    """What the step before leaves: f at its end, and whether there was one."""

    f_end: Float[Array, " n"]
    memory: Memory
    known: Bool[Array, ""]


class TRBDF2(AbstractStageSolver):
    """TR-BDF2, as in MATLAB's ode23tb: the trapezoidal rule to t₀ + (2 − √2) h, then the BDF formula of order 2.

    Order 2, L-stable, stiffly accurate. For stiff problems at low accuracy, with f that is expensive or
    not smooth. Both stages share one matrix, and an embedded formula of order 3 gives the error (Bank et
    al. 1985; Hosea & Shampine 1996).

    **Arguments:**

    - ``root_finder``: :class:`~jaxball.solvers.SimplifiedNewton` or :class:`~jaxball.solvers.FixedPoint`.
    """

    interpolation_cls: ClassVar = CubicHermite

    root_finder: AbstractStageIteration = SimplifiedNewton()

    def order(self, terms) -> int:
        return 2

    def error_order(self, terms) -> int:
        return 3

    def init(self, terms, t0: Any, t1: Any, y0, args) -> TRBDF2State:
        x0, _ = ravel_pytree(y0)
        return TRBDF2State(jnp.zeros_like(x0), self.root_finder.start(TABLEAU, x0), jnp.asarray(False))

    def step(self, terms, t0: Any, t1: Any, y0, args, solver_state, made_jump: Any):
        problem = flat_problem(terms, t0, t1, y0, args)
        problem.refuse_mass(self)
        x0, unravel, slope = problem.x0, problem.unravel, problem.slope
        k0 = first_slope(problem, t0, solver_state.known & ~jnp.asarray(made_jump), solver_state.f_end)
        times = jnp.stack([t0 + GAMMA * (t1 - t0), t1])
        equations = StageEquations(
            TABLEAU, slope, t0, times, x0, problem.control, unravel, known=combine(FIRST, k0[None])
        )
        stages = self.root_finder.solve(
            equations, jnp.broadcast_to(k0, (2, k0.size)), solver_state.memory.forgotten(made_jump)
        )
        error = combine(ERROR, jnp.concatenate([k0[None], stages.K]))[0]
        y_error, result = outcome(stages, smoothed(equations, stages, error), t0, t1)
        y1 = unravel(x0 + stages.Z[1])
        dense = {"y0": y0, "y1": y1, "k0": unravel(k0), "k1": unravel(stages.K[1])}
        f_end = stages.K[1] / problem.control.astype(x0.dtype)
        state = TRBDF2State(f_end, jax.lax.stop_gradient(stages.memory), jnp.asarray(True))
        return y1, unravel(y_error), dense, state, result
