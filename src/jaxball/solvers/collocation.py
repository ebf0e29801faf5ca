"""A step of a collocation method, whatever its nodes."""

import abc
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from .base import AbstractStageSolver
from .consistency import start_of_step
from .errors import AbstractErrorEstimate
from .flat import flat_problem
from .interpolation import CollocationPolynomial, legendre
from .mass import mass_term
from .outcome import NO_FAULT, UNKNOWN, outcome
from .stages import Memory, combine
from .tableau import Tableau


class CollocationState(NamedTuple):
    """The state passed from one step to the next: its polynomial, the slope at its end, and its iteration's state.

    ``fault`` says what is wrong with a problem M ẋ = g.
    """

    coefficients: Float[Array, "s n"]
    control: Float[Array, ""]
    slope: Float[Array, " n"]
    memory: Memory
    fault: Int[Array, ""] | None


class AbstractCollocation(AbstractStageSolver):
    """Collocation: the polynomial of degree s through y₀ that satisfies the equation at s nodes."""

    interpolation_cls: ClassVar = CollocationPolynomial

    error: eqx.AbstractVar[AbstractErrorEstimate]

    @property
    @abc.abstractmethod
    def tableau(self) -> Tableau:
        """The coefficients."""

    def error_order(self, terms) -> int:
        return self.error.order(len(self.tableau.c))

    def init(self, terms, t0: Any, t1: Any, y0, args) -> CollocationState:
        x0, _ = ravel_pytree(y0)
        fault = None if mass_term(terms) is None else jnp.asarray(UNKNOWN)
        empty = jnp.zeros((len(self.tableau.c), x0.size), x0.dtype)
        return CollocationState(empty, terms.contr(t0, t1), empty[0], self.root_finder.start(self.tableau, x0), fault)

    def step(self, terms, t0: Any, t1: Any, y0, args, solver_state, made_jump: Any):
        problem = flat_problem(terms, t0, t1, y0, args)
        tableau, unravel, mass = self.tableau, problem.unravel, problem.mass
        x0, fault = problem.x0, solver_state.fault
        if tableau.c[-1] != 1:
            # The end of a step is not a stage, and would not satisfy the equations without a derivative.
            problem.refuse_mass(self)
        if mass is not None:
            x0, fault = start_of_step(problem, mass, t0, self.root_finder, fault, made_jump)
        # Rounding must not lead past the end, which may be a kink.
        times = jnp.minimum(t0 + (t1 - t0) * jnp.asarray(tableau.c, jnp.result_type(t0)), t1)
        f0 = None
        if tableau.c[-1] == 1:
            slope = solver_state.slope * (problem.control / solver_state.control).astype(x0.dtype)
            f0 = slope if mass is None else mass.times(slope[None])[0]
        equations = problem.equations(tableau, t0, times, x0, f0=f0)
        guess = jnp.where(made_jump, 0.0, _predicted(tableau, solver_state, problem.control))
        stages = self.root_finder.solve(equations, guess, solver_state.memory.forgotten(made_jump))
        coefficients = combine(tableau.expansion, stages.K)
        increment = stages.Z[-1] if tableau.c[-1] == 1 else coefficients[0]
        error = jax.lax.stop_gradient(self.error.estimate(equations, stages, coefficients))
        if mass is not None:
            error = mass.without_algebraic(error)
        y_error, result = outcome(stages, error, t0, t1, NO_FAULT if fault is None else fault)
        dense = {"y0": unravel(x0), "coefficients": jax.vmap(unravel)(coefficients)}
        state = CollocationState(coefficients, problem.control, stages.K[-1], stages.memory, fault)
        return unravel(x0 + increment), unravel(y_error), dense, jax.lax.stop_gradient(state), result


def _predicted(tableau: Tableau, state: CollocationState, control: Float[Array, ""]) -> Float[Array, "s n"]:
    """The slopes at the nodes, by extrapolating the polynomial of the last step.

    Beyond its step P̃ₖ grows, the faster the higher k, so the last coefficients may be meaningless: terms are used as
    long as they decrease.
    """
    coefficients, s = state.coefficients, len(tableau.c)
    dtype, ratio = coefficients.dtype, control / state.control
    beyond = jnp.stack(legendre(1 + ratio * jnp.asarray(tableau.c, control.dtype), s), axis=1).astype(dtype)
    sizes = jnp.max(jnp.abs(coefficients), axis=1) * jnp.abs(beyond[-1])
    last = jnp.argmin(jnp.where(sizes > 0, sizes, jnp.inf))
    terms = jnp.where((jnp.arange(s) <= last)[:, None], coefficients, 0.0)
    return ratio.astype(dtype) * jnp.sum(beyond[:, :, None] * terms[None], axis=1)
