"""A step of a collocation method, whatever its nodes."""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .base import AbstractStageSolver
from .consistency import consistent_after_jump, fault_of
from .errors import AbstractErrorEstimate
from .flat import flat_problem
from .interpolation import CollocationPolynomial, legendre
from .outcome import NO_FAULT, outcome
from .stages import StageEquations, combine
from .tableau import Tableau


class CollocationState(NamedTuple):
    """What one step leaves to the next: its polynomial, and how fast its iteration converged.

    ``fault`` says what is wrong with a problem M ẋ = g.
    """

    coefficients: Float[Array, "s n"]
    control: Float[Array, ""]
    rate: Float[Array, ""]
    fault: Int[Array, ""] | None


class AbstractCollocation(AbstractStageSolver):
    """Collocation: the polynomial of degree s through y₀ that satisfies the equation at s nodes."""

    interpolation_cls: ClassVar = CollocationPolynomial

    error: eqx.AbstractVar[AbstractErrorEstimate]
    tableau: eqx.AbstractVar[Tableau]

    def error_order(self, terms) -> int:
        return self.error.order(len(self.tableau.c))

    def init(self, terms, t0: Any, t1: Any, y0, args) -> CollocationState:
        problem = flat_problem(terms, t0, t1, y0, args)
        fault = None if problem.mass is None else fault_of(problem, problem.mass, t0, self.root_finder)
        empty = jnp.zeros((len(self.tableau.c), problem.x0.size), problem.x0.dtype)
        return CollocationState(empty, problem.control, jnp.asarray(1.0, empty.dtype), fault)

    def step(self, terms, t0: Any, t1: Any, y0, args, solver_state, made_jump: Any):
        problem = flat_problem(terms, t0, t1, y0, args)
        tableau, unravel = self.tableau, problem.unravel
        x0 = problem.x0 if problem.mass is None else consistent_after_jump(problem, problem.mass, t0, made_jump)
        times = t0 + (t1 - t0) * jnp.asarray(tableau.c, jnp.result_type(t0))
        equations = StageEquations(tableau, problem.slope, t0, times, x0, unravel, problem.mass)
        guess = jnp.where(made_jump, 0.0, _predicted(tableau, solver_state, problem.control))
        stages = self.root_finder.solve(equations, guess, solver_state.rate)
        coefficients = combine(tableau.expansion, stages.K)
        increment = stages.Z[-1] if tableau.c[-1] == 1 else coefficients[0]
        error = jax.lax.stop_gradient(self.error.estimate(equations, stages, coefficients))
        fault = NO_FAULT
        if problem.mass is not None:
            error, fault = problem.mass.without_algebraic(error), solver_state.fault
        y_error, result = outcome(stages, error, t0, t1, fault)
        dense = {"y0": unravel(x0), "coefficients": jax.vmap(unravel)(coefficients)}
        memory = jax.lax.stop_gradient((coefficients, problem.control, stages.rate))
        state = CollocationState(*memory, solver_state.fault)
        return unravel(x0 + increment), unravel(y_error), dense, state, result


def _predicted(tableau: Tableau, state: CollocationState, control: Float[Array, ""]) -> Float[Array, "s n"]:
    """The slopes at the nodes, if the polynomial of the last step went on."""
    ratio = control / state.control
    beyond = legendre(1 + ratio * jnp.asarray(tableau.c, control.dtype), len(tableau.c))
    weights = ratio * jnp.stack(beyond, axis=1)
    return jnp.sum(weights[:, :, None].astype(state.coefficients.dtype) * state.coefficients[None], axis=1)
