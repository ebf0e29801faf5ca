"""What all solvers here share: the problem of a step as flat vectors, the outcome of a step, and base classes."""

import functools
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int, PyTree

from .mass import Mass, mass_term, unwrap
from .stages import AbstractStageIteration, StageEquations, Stages
from .tableau import Tableau


class Slope(eqx.Module):
    """The slope h g(t, x) of a step, as a function of t and x."""

    field: Callable[[Float[Array, ""], Float[Array, " n"]], Float[Array, " n"]]
    control: Float[Array, ""]

    def __call__(self, t: Float[Array, ""], x: Float[Array, " n"]) -> Float[Array, " n"]:
        return self.field(t, x) * self.control.astype(x.dtype)


class FlatProblem(NamedTuple):
    """The problem of one step: g(t, x), h g(t, x) and M, with x as one flat vector."""

    field: Callable[[Float[Array, ""], Float[Array, " n"]], Float[Array, " n"]]
    slope: Slope
    x0: Float[Array, " n"]
    unravel: Callable[[Float[Array, " n"]], PyTree[Array]]
    control: Float[Array, ""]
    mass: Mass | None

    def equations(
        self, tableau: Tableau, t0: Float[Array, ""], times: Float[Array, " s"], x0: Float[Array, " n"], **known: Any
    ) -> StageEquations:
        """Returns the equations that the stages at ``times`` of a step from x₀ satisfy; ``known`` are their other
        fields.
        """
        return StageEquations(
            tableau=tableau,
            slope=self.slope,
            t0=t0,
            times=times,
            x0=x0,
            control=self.control,
            unravel=self.unravel,
            mass=self.mass,
            **known,
        )

    def refuse_mass(self, solver: diffrax.AbstractSolver) -> None:
        """Raises ``TypeError`` if there is a mass matrix, which ``solver`` does not support."""
        if self.mass is not None:
            raise TypeError(
                "Argument `solver` must be a RadauIIA, NDF, Trapezoidal or TRBDF2 for a term with a mass matrix, "
                "M ẋ = g(t, x), "
                f"but it is a {type(solver).__name__}."
            )


def flat_problem(
    terms: diffrax.AbstractTerm, t0: Float[Array, ""], t1: Float[Array, ""], y0: PyTree[Array], args: Any
) -> FlatProblem:
    """Builds the problem that ``terms`` pose for the step from ``t0`` to ``t1``.

    **Raises:** ``TypeError`` for a term whose control is not time, as in a stochastic equation, and for a
    state that is not real.
    """
    x0, unravel = ravel_pytree(y0)
    term = unwrap(terms)
    if isinstance(term, (diffrax.ControlTerm, diffrax.MultiTerm)):
        raise TypeError(
            "Argument `terms` must be an ordinary differential equation for a solver of jaxball.simulation.solvers, an "
            f"ODETerm or a MassMatrixTerm, but it is a {type(term).__name__}; use one of diffrax's solvers for it."
        )
    control = terms.contr(t0, t1)
    if not jnp.issubdtype(x0.dtype, jnp.floating):
        raise TypeError(
            f"Argument `y0` must be real floating-point numbers of one kind, but it is {x0.dtype}; "
            "give a complex state as its real and imaginary parts."
        )
    mass_problem = mass_term(terms)
    if mass_problem is None:
        field, mass = terms.vf, None
    else:
        # diffrax runs time backwards by changing its sign.
        direction = getattr(terms, "direction", 1)
        g, mass = mass_problem.at_step(t0 * direction, y0, args)
        field = functools.partial(_reflect, g, direction)

    def flat(t, x):
        return ravel_pytree(field(t, unravel(x), args))[0].astype(x.dtype)

    # Traced once here, rather than by each user.
    flat = eqx.filter_closure_convert(flat, t0, x0)
    return FlatProblem(flat, Slope(flat, control), x0, unravel, control, mass)


def _reflect(g, direction, t, y, args):
    return g(t * direction, y, args)


# Typed loosely: to a type checker, the items of an enumeration of equinox are not of its type.
RESULTS: Any = diffrax.RESULTS

# The faults of a problem M ẋ = g.
NO_FAULT, INCONSISTENT, NOT_INDEX_ONE, UNKNOWN = 0, 1, 2, 3

SENTENCES: list[tuple[Any, str]] = [
    (RESULTS.successful, ""),
    (
        RESULTS.nonfinite,
        "The vector field is not a finite number, however short the step. Check where the solve ended, with "
        "SaveAt(t1=True) and throw=False.",
    ),
    (
        RESULTS.nonlinear_divergence,
        "The iteration for the stages does not converge, however short the step. If its root finder is FixedPoint, "
        "the problem may be stiff: use SimplifiedNewton. Otherwise the vector field may jump: give its kinks to "
        "StepToKinks.",
    ),
    (
        RESULTS.singular,
        "The equations do not determine the step: either those without a derivative do not determine the algebraic "
        "variables, because the index is greater than 1, or the matrix of the iteration is singular, however short "
        "the step. Differentiate constraints until they hold the algebraic variables.",
    ),
    (
        RESULTS.nonlinear_max_steps_reached,
        "The initial values do not satisfy the equations without a derivative. Start from those that "
        "consistent_initial_values finds.",
    ),
    (
        RESULTS.max_steps_reached,
        "The solve has taken all its steps. Give it more max_steps, or a looser tolerance; if most were "
        "rejected, the problem may be too stiff for the solver, or its vector field may jump.",
    ),
    (
        RESULTS.dt_min_reached,
        "The steps became shorter than the step-size controller allows: the tolerance was out of reach at the time "
        "where the solve ended.",
    ),
    (RESULTS.event_occurred, "An event ended the solve."),
]


def explain(result: diffrax.RESULTS) -> str:
    """Says in a sentence how a solve by a solver of this package ended, for its ``result`` by diffrax; empty for
    success.
    """
    for outcome, sentence in SENTENCES:
        if bool(result == outcome):
            return sentence
    return str(RESULTS[result])


def at_limit(t0: Float[Array, ""], t1: Float[Array, ""]) -> Bool[Array, ""]:
    """Returns whether a step is so short that time hardly advances."""
    info = jnp.finfo(t0.dtype)
    shortest = jnp.maximum(16 * info.eps * jnp.maximum(jnp.abs(t0), jnp.abs(t1)), jnp.sqrt(info.tiny))
    return jnp.abs(t1 - t0) <= shortest


def outcome(
    stages: Stages,
    error: Float[Array, " n"],
    t0: Float[Array, ""],
    t1: Float[Array, ""],
    fault: Int[Array, ""] | int = NO_FAULT,
) -> tuple[Float[Array, " n"], diffrax.RESULTS]:
    """Returns the error estimate and the result of a step.

    A step whose stages were given up has an infinite error, so that a step-size controller tries a shorter one. When it
    is so short that time hardly advances, or if the step would be accepted anyway, as with a constant step size, the
    solve ends with a result that says why. A fault of the problem ends it at once.
    """
    at_end = at_limit(t0, t1) | (fault != NO_FAULT)
    # An infinite error is rejected by every controller, and asks for a shorter step.
    y_error = jnp.where(stages.converged, error, jnp.inf)
    finite = jnp.all(jnp.isfinite(stages.K))
    why = RESULTS.where(finite, RESULTS.nonlinear_divergence, RESULTS.nonfinite)
    why = RESULTS.where(stages.singular, RESULTS.singular, why)
    result = RESULTS.where(stages.converged, RESULTS.successful, why)
    result = RESULTS.where(fault == INCONSISTENT, RESULTS.nonlinear_max_steps_reached, result)
    result = RESULTS.where(fault == NOT_INDEX_ONE, RESULTS.singular, result)
    failed = ~stages.converged | (fault != NO_FAULT)
    # diffrax ends a solve by the result of a step only if that is accepted: so one that cannot be shortened is.
    return jnp.where(failed & at_end, 0.0, y_error), result


# The part of the time until a singularity that a step may take, if the solver does not say.
APPROACH = 0.5


def approach_of(solver: diffrax.AbstractSolver) -> float:
    """Returns the largest part of the time until a singularity of the solution, such as the end of a slip, for one
    step.

    It is the solver's attribute ``approach``, from 0 to 1, or 0.5 without one. Near a singularity the scales of time
    are proportional to the time that is left, and a step much longer than them is not stable, which error estimates by
    a few points may not notice. A method whose region of stability is small has a smaller one.
    """
    return getattr(solver, "approach", APPROACH)


class AbstractImplicit(diffrax.AbstractImplicitSolver, diffrax.AbstractAdaptiveSolver):
    """What implicit methods for diffrax share: a field as its terms, and a limit of their iterations in a step."""

    term_structure: ClassVar = diffrax.AbstractTerm

    root_finder: eqx.AbstractVar[Any]  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def root_find_max_steps(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The most iterations before a step is given up."""
        return self.root_finder.max_steps

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)


class AbstractStageSolver(AbstractImplicit):
    """An implicit one-step method for diffrax whose stages a :class:`AbstractStageIteration` finds."""

    root_finder: eqx.AbstractVar[AbstractStageIteration]  # pyright: ignore[reportIncompatibleVariableOverride]
