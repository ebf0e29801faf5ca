"""What a step tells diffrax when its stages could not be solved."""

import diffrax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .stages import Stages

RESULTS = diffrax.RESULTS


def outcome(
    stages: Stages, error: Float[Array, " n"], t0: Float[Array, ""], t1: Float[Array, ""]
) -> tuple[Float[Array, " n"], diffrax.RESULTS]:
    """The error estimate and the result of a step.

    A step whose stages were given up has an infinite error, so that a step-size controller tries a
    shorter one. When it is so short that time hardly moves, or where the step is kept all the same, as with
    a constant step size, the solve ends with a result that says so.
    """
    last = jnp.abs(t1 - t0) <= 16 * jnp.finfo(t0.dtype).eps * jnp.maximum(jnp.abs(t0), jnp.abs(t1))
    failed = jnp.where(last, 0.0, jnp.inf)
    finite = jnp.all(jnp.isfinite(stages.K))
    why = RESULTS.where(finite, RESULTS.nonlinear_divergence, RESULTS.nonfinite)
    return jnp.where(stages.converged, error, failed), RESULTS.where(stages.converged, RESULTS.successful, why)
