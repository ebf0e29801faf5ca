"""What a step reports to diffrax when something went wrong, and what that means."""

from typing import Any

import diffrax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .stages import Stages

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
    """A sentence on how a solve by a solver of this package ended, for ``solution.result``; empty for success.

    **Arguments:**

    - ``result``: ``solution.result`` of diffrax.
    """
    for known, sentence in SENTENCES:
        if bool(result == known):
            return sentence
    return str(RESULTS[result])


def at_limit(t0: Float[Array, ""], t1: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether a step is so short that time hardly advances."""
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
    """The error estimate and the result of a step.

    A step whose stages were given up has an infinite error, so that a step-size controller tries a shorter one. When it
    is so short that time hardly advances, or if the step would be accepted anyway, as with a constant step size, the
    solve ends with a result that says why. A fault of the problem ends it at once.
    """
    at_end = at_limit(t0, t1) | (fault != NO_FAULT)
    y_error = jnp.where(stages.converged, error, jnp.inf)
    finite = jnp.all(jnp.isfinite(stages.K))
    why = RESULTS.where(finite, RESULTS.nonlinear_divergence, RESULTS.nonfinite)
    why = RESULTS.where(stages.singular, RESULTS.singular, why)
    result = RESULTS.where(stages.converged, RESULTS.successful, why)
    result = RESULTS.where(fault == INCONSISTENT, RESULTS.nonlinear_max_steps_reached, result)
    result = RESULTS.where(fault == NOT_INDEX_ONE, RESULTS.singular, result)
    failed = ~stages.converged | (fault != NO_FAULT)
    return jnp.where(failed & at_end, 0.0, y_error), result
