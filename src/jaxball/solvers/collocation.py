"""A step of a collocation method, whatever its nodes."""

from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .errors import AbstractErrorEstimate
from .flat import flat_problem
from .interpolation import CollocationPolynomial, legendre
from .outcome import outcome
from .stages import AbstractStageIteration, StageEquations, combine
from .tableau import Tableau


class CollocationState(NamedTuple):
    """What one step leaves to the next: its polynomial, and how fast the iteration converged."""

    coefficients: Float[Array, "s n"]
    control: Float[Array, ""]
    rate: Float[Array, ""]


class AbstractCollocation(diffrax.AbstractImplicitSolver, diffrax.AbstractAdaptiveSolver):
    """Collocation: the polynomial of degree s through y₀ that satisfies the equation at s nodes."""

    term_structure: ClassVar = diffrax.AbstractTerm
    interpolation_cls: ClassVar = CollocationPolynomial

    root_finder: eqx.AbstractVar[AbstractStageIteration]
    error: eqx.AbstractVar[AbstractErrorEstimate]
    tableau: eqx.AbstractVar[Tableau]

    @property
    def root_find_max_steps(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Iterations after which a step is given up."""
        return self.root_finder.max_steps

    def error_order(self, terms) -> int:
        return self.error.order(len(self.tableau.c))

    def init(self, terms, t0, t1, y0, args) -> CollocationState:
        x0, _ = ravel_pytree(y0)
        s = len(self.tableau.c)
        return CollocationState(jnp.zeros((s, x0.size), x0.dtype), terms.contr(t0, t1), jnp.asarray(1.0, x0.dtype))

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        problem = flat_problem(terms, t0, t1, y0, args)
        tableau = self.tableau
        times = t0 + jnp.asarray(tableau.c, t0.dtype) * (t1 - t0)
        equations = StageEquations(tableau, problem.slope, t0, times, problem.x0, problem.unravel, problem.mass)
        guess = jnp.where(made_jump, 0.0, _predicted(tableau, solver_state, problem.control))
        stages = self.root_finder.solve(equations, jax.lax.stop_gradient(guess), solver_state.rate)
        coefficients = combine(tableau.expansion, stages.K)
        increment = stages.Z[-1] if tableau.c[-1] == 1 else coefficients[0]
        error = jax.lax.stop_gradient(self.error.estimate(equations, stages, coefficients))
        if problem.mass is not None:
            error = problem.mass.without_algebraic(error)
        y_error, result = outcome(stages, error, t0, t1)
        unravel = problem.unravel
        dense = dict(y0=y0, coefficients=jax.vmap(unravel)(coefficients))
        state = CollocationState(*jax.lax.stop_gradient((coefficients, problem.control, stages.rate)))
        return unravel(problem.x0 + increment), unravel(y_error), dense, state, result


def _predicted(tableau: Tableau, state: CollocationState, control: Float[Array, ""]) -> Float[Array, "s n"]:
    """The slopes at the nodes, if the polynomial of the last step went on."""
    ratio = control / state.control
    beyond = legendre(1 + ratio * jnp.asarray(tableau.c, control.dtype), len(tableau.c))
    weights = ratio * jnp.stack(beyond, axis=1)
    return jnp.sum(weights[:, :, None].astype(state.coefficients.dtype) * state.coefficients[None], axis=1)
