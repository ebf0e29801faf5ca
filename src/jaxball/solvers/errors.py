"""Estimates of the error of a step of a collocation method."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .stages import StageEquations, Stages, combine


class AbstractErrorEstimate(eqx.Module):
    """An estimate of the error of a step."""

    @abc.abstractmethod
    def order(self, stages: int) -> int:
        """The power of the step that the estimate is proportional to."""

    @abc.abstractmethod
    def estimate(
        self, equations: StageEquations, stages: Stages, coefficients: Float[Array, "s n"]
    ) -> Float[Array, " n"]:
        """The estimate, given the Legendre ``coefficients`` of the slopes K."""


class EmbeddedError(AbstractErrorEstimate):
    """For stiff problems: the estimate of radau5, for any odd number of stages.

    The slope of the collocation polynomial at the start of the step misses the vector field there by a
    defect; (γM − h∂g/∂x)⁻¹ times it is the distance to an embedded formula of order s, and stays small
    in stiff components (Hairer & Wanner 1996, section IV.8, eqs. (8.17)–(8.19)).
    """

    def order(self, stages: int) -> int:
        return stages + 1

    def estimate(self, equations, stages, coefficients):
        f0 = equations.slope(equations.t0, equations.x0) if stages.f0 is None else stages.f0
        at_start = (-1.0) ** np.arange(len(coefficients))
        defect = f0 - equations.mass_times(combine(at_start[None], coefficients))[0]
        return smoothed(equations, stages, defect / float(equations.tableau.eigenvalues[0].real))


class TailError(AbstractErrorEstimate):
    """For smooth problems, where the solution is needed between the steps as well.

    The last Legendre coefficients of the slopes predict the next ones, which the collocation polynomial lacks, so its
    error is controlled over the whole step.
    """

    def order(self, stages: int) -> int:
        return stages - 1

    def estimate(self, equations, stages, coefficients):
        return _tail(coefficients) / (2 * len(coefficients))


class StepError(AbstractErrorEstimate):
    """For smooth problems, where the solution is needed only at the ends of steps.

    There a collocation method has about twice the order that it has between (superconvergence): its error is the
    product of two truncated tails of the same decay, that of the polynomial and that of the problem's sensitivity, and
    is estimated as the tail squared over the leading coefficient. Steps become about twice as long as with
    :class:`TailError`; the dense output then has only about half the requested digits.
    """

    def order(self, stages: int) -> int:
        return 2 * stages - 3

    def estimate(self, equations, stages, coefficients):
        tail = _tail(coefficients)
        largest = jnp.max(jnp.abs(coefficients), axis=0)
        return tail * tail / jnp.maximum(largest, jnp.finfo(tail.dtype).tiny)


def _tail(coefficients: Float[Array, "s n"]) -> Float[Array, " n"]:
    """The last coefficient or the one before: either alone may vanish by symmetry."""
    return jnp.max(jnp.abs(coefficients[-2:]), axis=0)


def smoothed(equations: StageEquations, stages: Stages, error: Float[Array, " n"]) -> Float[Array, " n"]:
    """``error`` with its stiff components damped, γ (γM − h∂g/∂x)⁻¹ times it, where the iteration has the matrix.

    The result must not be differentiated: it is only for choosing steps.
    """
    if stages.smooth is not None:
        error = float(equations.tableau.eigenvalues[0].real) * jnp.sum(stages.smooth * error[None], axis=1)
    return jax.lax.stop_gradient(error)
