"""What an optimal control problem is."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

# By how much an inequality may be violated between the nodes.
VIOLATION = 1e-4


class AbstractControlProblem(eqx.Module):
    """Minimise the mean over [start, end] of a running cost, from a given state to one that fulfils end conditions.

    min 1/T ∫ cost(t, x, u) dt  with  ẋ = rate(t, x, u),  x(start) = x_a,  conditions(x(end)) = 0,
    inequalities(t, x, u) ≥ 0,  T = end − start.

    The conditions are in fact conditions(x(end)) = ``softness`` · multipliers, which is 0 in the problem that is to be
    solved. With more, they are not kept but cost |conditions|² / (2 softness), so that a problem is regular also where
    some of them say nothing to first order; from there, the softness is brought to 0 by continuation.
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
        """What is small in a good motion, at one time."""

    @abc.abstractmethod
    def conditions(self, x: Float[Array, " n"]) -> Float[Array, " k"]:
        """What must vanish at the end."""

    def inequalities(self, t: Float[Array, ""], x: Float[Array, " n"], u: Float[Array, " m"]) -> Float[Array, " i"]:
        """What must not be negative at any time, with second derivatives everywhere; nothing if not overridden."""
        return jnp.zeros_like(t, shape=(0,))
