"""Consistent initial values of problems with a mass matrix."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int, PyTree

from .flat import FlatProblem
from .linear import factorise, product
from .mass import AbstractMassTerm, Mass
from .newton import value_and_jacobian
from .outcome import INCONSISTENT, NO_FAULT, NOT_INDEX_ONE
from .stages import AbstractStageIteration

# Beyond this condition number the equations without a derivative do not determine the algebraic variables.
WORST_CONDITION = 1e-3
MAX_STEPS = 20


class Correction(NamedTuple):
    """What is lacking for the equations without a derivative to hold, to first order.

    ``change`` is what to add to the algebraic variables; ``index_one`` says whether it is determined.
    """

    change: Float[Array, " n"]
    index_one: Bool[Array, ""]


class InitialValues(eqx.Module):
    """What :func:`consistent_initial_values` found."""

    y: PyTree[Array]
    converged: Bool[Array, ""]
    index_one: Bool[Array, ""]

    @property
    def ok(self) -> Bool[Array, ""]:
        """Whether ``y`` is consistent."""
        return self.converged & self.index_one

    @property
    def message(self) -> str:
        """A sentence on what went wrong; empty if nothing did."""
        if not self.index_one:
            return INDEX_TOO_HIGH
        return "" if self.converged else NOT_FOUND


INDEX_TOO_HIGH = (
    "The equations without a derivative do not determine the algebraic variables: the index is greater than 1, at "
    "least there. Differentiate constraints until they hold these variables, or choose others as algebraic."
)
NOT_FOUND = (
    "No consistent values were found near those given: Newton's iteration on the equations without a derivative did "
    "not converge. Start it from better algebraic variables."
)


def consistent_initial_values(
    term: AbstractMassTerm, t0: Any, y0: PyTree[Array], args: Any = None, *, throw: bool = False
) -> InitialValues:
    """Changes the algebraic variables of ``y0`` until the equations without a derivative hold.

    M y₀ stays what it is, so that a diagonal M means that the other variables do.

    **Arguments:** those of ``diffrax.diffeqsolve``; ``throw`` says whether to raise where none are found.

    **Raises:** ``ValueError`` if asked to.
    """
    y0 = jax.tree.map(jnp.asarray, y0)
    t0 = jnp.asarray(t0, jnp.result_type(*jax.tree.leaves(y0)))
    field, mass = term.at_step(t0, y0, args)
    x0, unravel = ravel_pytree(y0)
    x, converged, index_one = solve_algebraic(lambda x: ravel_pytree(field(t0, unravel(x), args))[0], mass, x0)
    found = InitialValues(unravel(x), converged, index_one)
    if throw and not found.ok:
        raise ValueError(found.message)
    return found


def solve_algebraic(
    g, mass: Mass, x0: Float[Array, " n"]
) -> tuple[Float[Array, " n"], Bool[Array, ""], Bool[Array, ""]]:
    """``x0`` with the algebraic part corrected, whether that converged, and whether the index is 1."""
    eps = jnp.finfo(x0.dtype).eps

    def small(x, change):
        return jnp.all(jnp.abs(change) <= 16 * eps * (jnp.abs(x) + jnp.max(jnp.abs(x))))

    def unfinished(carry):
        x, correction, count = carry
        return ~small(x, correction.change) & correction.index_one & (count < MAX_STEPS)

    def improve(carry):
        x, correction, count = carry
        x = x + correction.change
        return x, algebraic_correction(g, mass, x), count + 1

    x, correction, _ = jax.lax.while_loop(unfinished, improve, (x0, algebraic_correction(g, mass, x0), 0))
    return x, small(x, correction.change), correction.index_one


def algebraic_correction(g: Callable, mass: Mass, x: Float[Array, " n"]) -> Correction:
    """One step of Newton's iteration for the equations without a derivative.

    M + R (∂g/∂x) V, with the projections R on these equations and V on the algebraic variables, takes
    apart into M between the differential parts and the Jacobian between the algebraic ones, which is
    regular if and only if the index is 1.
    """
    value, J = value_and_jacobian(g, x)
    matrix = mass.matrix + product(product(mass.residuals, J), mass.variables)
    scale = jnp.max(jnp.abs(matrix), axis=1)
    scaled = matrix / jnp.where(scale == 0, 1.0, scale)[:, None]
    inverse = factorise(scaled[None]).inverses[0]
    condition = jnp.max(jnp.sum(jnp.abs(inverse), axis=1)) * jnp.max(jnp.sum(jnp.abs(scaled), axis=1))
    index_one = condition * jnp.finfo(x.dtype).eps < WORST_CONDITION
    residual = product(mass.residuals, value[:, None]) / jnp.where(scale == 0, 1.0, scale)[:, None]
    change = -product(inverse, residual)[:, 0]
    return Correction(jnp.where(index_one, change, 0.0), index_one & jnp.all(jnp.isfinite(value)))


def fault_of(problem: FlatProblem, mass: Mass, t0: Float[Array, ""], measure: AbstractStageIteration) -> Int[Array, ""]:
    """What is wrong with the values at the start: not consistent to within the tolerance, or not of index 1."""
    correction = algebraic_correction(lambda x: problem.field(t0, x), mass, problem.x0)
    scaled = correction.change / (measure.atol + measure.rtol * jnp.abs(problem.x0))
    consistent = measure.norm(problem.unravel(scaled)) <= 1
    fault = jnp.where(consistent, NO_FAULT, INCONSISTENT)
    return jax.lax.stop_gradient(jnp.where(correction.index_one, fault, NOT_INDEX_ONE))


def consistent_after_jump(
    problem: FlatProblem, mass: Mass, t0: Float[Array, ""], made_jump: Bool[Array, ""] | bool
) -> Float[Array, " n"]:
    """The state at the start of a step, whose algebraic variables may have jumped with g."""
    if made_jump is False:
        return problem.x0

    def corrected(x0):
        x, converged, _ = solve_algebraic(lambda x: problem.field(t0, x), mass, x0)
        return jnp.where(converged, x, x0)

    change = jax.lax.cond(made_jump, lambda x0: corrected(x0) - x0, jnp.zeros_like, problem.x0)
    # The stages depend on the sum of this change and their increments alone.
    return problem.x0 + jax.lax.stop_gradient(change)
