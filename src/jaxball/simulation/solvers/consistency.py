"""Consistent initial values of problems with a mass matrix, for users and for the steps of the implicit methods.

Every such step calls ``start_of_step``, which solves only in the first one and after a jump.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, ArrayLike, Bool, Float, Int, PyTree

from ...numerics.linear import inverse, product
from ...numerics.vectors import apply
from .base import INCONSISTENT, NO_FAULT, NOT_INDEX_ONE, UNKNOWN, FlatProblem
from .mass import AbstractMassTerm, Mass
from .stages import AbstractStageIteration, value_and_jacobian

# If rounding, magnified by the condition number, exceeds this, the algebraic variables count as undetermined.
WORST_CONDITION = 1e-3
MOST_NEWTON_STEPS = 20


class InitialValues(eqx.Module):
    """The result of :func:`consistent_initial_values`.

    **Arguments:**

    - ``y``: the values.
    - ``converged``: whether they fulfil the equations.
    - ``index_one``: whether the algebraic equations determine the algebraic variables.
    """

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
    term: AbstractMassTerm, t0: Any, y0: PyTree[ArrayLike], args: Any = None, *, throw: bool = False
) -> InitialValues:
    """Changes the algebraic variables of ``y0`` until the equations without a derivative hold.

    M y₀ does not change, so with a diagonal M the other variables do not change.

    **Arguments:**

    - ``term``, ``t0``, ``y0``, ``args``: as for ``diffrax.diffeqsolve``.
    - ``throw``: whether to raise if none are found.

    **Raises:** ``ValueError`` with ``throw``.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball.simulation.solvers import MassMatrixTerm, consistent_initial_values
    >>> def circle(t, y, args):
    ...     return jnp.stack([-y[1], y[0] ** 2 + y[1] ** 2 - 1.0])  # ẋ = −y and 0 = x² + y² − 1
    >>> term = MassMatrixTerm(circle, mass=jnp.array([1.0, 0.0]))
    >>> consistent_initial_values(term, 0.0, jnp.array([0.6, 1.0])).y
    Array([0.6, 0.8], dtype=float64)
    """
    y0 = jax.tree.map(jnp.asarray, y0)
    t0 = jnp.asarray(t0, jnp.result_type(*jax.tree.leaves(y0)))
    field, mass = term.at_step(t0, y0, args)
    x0, unravel = ravel_pytree(y0)
    solved = solve_algebraic(lambda x: ravel_pytree(field(t0, unravel(x), args))[0], mass, x0)
    values = InitialValues(unravel(solved.x), solved.converged, solved.index_one)
    if throw and not values.ok:
        raise ValueError(values.message)
    return values


class Solved(NamedTuple):
    """Where Newton's iteration for the algebraic variables ended.

    ``lacking`` is what it changed at first, or would have.
    """

    x: Float[Array, " n"]
    lacking: Float[Array, " n"]
    converged: Bool[Array, ""]
    index_one: Bool[Array, ""]
    passes: Int[Array, ""]


def solve_algebraic(g: Callable, mass: Mass, x0: Float[Array, " n"], needed: Bool[Array, ""] | bool = True) -> Solved:
    """Solves the equations without a derivative for the algebraic variables, where it is ``needed``.

    It is all in one loop: another Jacobian in a program costs more to compile than the rest.
    """
    eps = jnp.finfo(x0.dtype).eps

    def is_unfinished(iterate: Solved):
        return ~iterate.converged & iterate.index_one & (iterate.passes < MOST_NEWTON_STEPS)

    def improve(iterate: Solved) -> Solved:
        change, index_one = _correction(g, mass, iterate.x)
        # Down to rounding, not to the tolerance, because steps do not estimate the errors of algebraic variables.
        small = jnp.all(jnp.abs(change) <= 16 * eps * (jnp.abs(iterate.x) + jnp.max(jnp.abs(iterate.x))))
        lacking = jnp.where(iterate.passes == 0, change, iterate.lacking)
        return Solved(iterate.x + change, lacking, small & index_one, index_one, iterate.passes + 1)

    start = Solved(x0, jnp.zeros_like(x0), ~jnp.asarray(needed), jnp.asarray(True), jnp.asarray(0))
    return jax.lax.while_loop(is_unfinished, improve, start)


def _correction(g: Callable, mass: Mass, x: Float[Array, " n"]) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
    """Computes one step of Newton's iteration for the equations without a derivative, and whether it is determined.

    M + R (∂g/∂x) V, with the projections R on these equations and V on the algebraic variables, separates into M
    between the differential parts and the Jacobian between the algebraic ones, which is regular if and only if the
    index is 1.
    """
    value, J = value_and_jacobian(g, x)
    matrix = mass.matrix + product(product(mass.residuals, J), mass.variables)
    # Equations of different units would look nearly singular: rows are scaled to the same size.
    scale = jnp.max(jnp.abs(matrix), axis=1, keepdims=True)
    scale = jnp.where(scale == 0, 1.0, scale)
    inverse_matrix = inverse(matrix / scale)
    condition = jnp.max(jnp.sum(jnp.abs(inverse_matrix), axis=1)) * jnp.max(jnp.sum(jnp.abs(matrix / scale), axis=1))
    # NaN determines nothing, and is another fault.
    index_one = (condition * jnp.finfo(x.dtype).eps < WORST_CONDITION) | ~jnp.all(jnp.isfinite(J))
    change = -apply(inverse_matrix, apply(mass.residuals, value) / scale[:, 0])
    return jnp.where(index_one, change, 0.0), index_one


def start_of_step(
    problem: FlatProblem,
    mass: Mass,
    t0: Float[Array, ""],
    measure: AbstractStageIteration,
    fault: Int[Array, ""],
    made_jump: Bool[Array, ""] | bool,
) -> tuple[Float[Array, " n"], Int[Array, ""]]:
    """Returns the state at the start of a step, and says what is wrong with the problem.

    On the first step, where ``fault`` is UNKNOWN, the state must be consistent to within the tolerance; after
    a jump of g the algebraic variables may jump as well.
    """
    first = fault == UNKNOWN
    solved = solve_algebraic(lambda x: problem.field(t0, x), mass, problem.x0, first | made_jump)
    scaled = solved.lacking / (measure.atol + measure.rtol * jnp.abs(problem.x0))
    # If g is not a number, the step itself reports it.
    at_start = jnp.where(measure.norm(problem.unravel(scaled)) > 1, INCONSISTENT, NO_FAULT)
    at_start = jnp.where(solved.index_one, at_start, NOT_INDEX_ONE)
    change = jnp.where(solved.converged, solved.x - problem.x0, 0.0)
    # The stages depend on the sum of this change and their increments alone, so it has no derivative to pass.
    return problem.x0 + jax.lax.stop_gradient(change), jnp.where(first, at_start, fault)
