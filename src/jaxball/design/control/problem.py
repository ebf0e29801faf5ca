"""The contract of optimal control problems."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

# The violation of an inequality that is allowed between the nodes.
VIOLATION = 1e-4


class AbstractControlProblem(eqx.Module):
    """Minimise the mean over [start, end] of a running cost, from a given state to one that fulfils end conditions.

    min 1/T ∫ cost(t, x, u) dt  with  ẋ = rate(t, x, u),  x(start) = x_a,  conditions(x(end)) = 0,
    inequalities(t, x, u) ≥ 0,  T = end − start.

    The conditions are in fact conditions(x(end)) = ``softness`` · multipliers, with softness 0 in the problem to be
    solved. A positive softness replaces them by the cost |conditions|² / (2 softness), so that a problem is regular
    even where some of them are redundant to first order; from there, continuation brings the softness to 0.
    """

    start: eqx.AbstractVar[Float[Array, ""]]
    end: eqx.AbstractVar[Float[Array, ""]]
    softness: eqx.AbstractVar[Float[Array, ""]]

    @property
    @abc.abstractmethod
    def controls(self) -> int:
        """The number m of controls."""

    @property
    @abc.abstractmethod
    def initial(self) -> Float[Array, " n"]:
        """x_a."""

    @abc.abstractmethod
    def rate(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, " n"]:
        """ẋ."""

    @abc.abstractmethod
    def cost(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, ""]:
        """The running cost at one time."""

    @abc.abstractmethod
    def conditions(self, x: Float[Array, " n"]) -> Float[Array, " k"]:
        """The conditions that must vanish at the end."""

    def inequalities(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, " i"]:
        """Functions that must not be negative at any time, with second derivatives everywhere; by default none."""
        return jnp.zeros_like(t, shape=(0,))
