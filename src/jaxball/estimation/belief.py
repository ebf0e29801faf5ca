"""What is known at one moment: a state, biases of sensors, and the covariance of the errors of both."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..physics.state import PlacedState

# Of a covariance scaled to a diagonal of 1, an eigenvalue below which a combination is known, but for rounding.
KNOWN = 1e-12


class Belief(NamedTuple):
    """An estimate: its errors are the local coordinates of the true state around ``state``, then those of biases."""

    state: PlacedState
    bias: Float[Array, " biases"]
    P: Float[Array, "n n"]

    def moved(self, change: Float[Array, " n"]) -> "Belief":
        """The estimate changed by an error, and the covariance in local coordinates around the new state."""
        xi, own = change[: change.size - self.bias.size], change[change.size - self.bias.size :]
        state = self.state.retract(xi)
        turn = jax.jacfwd(lambda d: state.difference(self.state.retract(xi + d)))(jnp.zeros_like(xi))
        G = jnp.eye(len(self.P), dtype=self.P.dtype).at[: xi.size, : xi.size].set(turn)
        return Belief(state, self.bias + own, symmetric(G @ self.P @ G.T))


def symmetric(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The symmetric part, without the rounding of products."""
    return 0.5 * (P + P.T)


def is_uncertain(P: Float[Array, "n n"]) -> Bool[Array, " n"]:
    """Of each principal direction of a covariance, whether there is any doubt about it."""
    return _principal(P)[0] > KNOWN


def inverse(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The inverse of a covariance on the directions that are uncertain, 0 on those that are known."""
    values, vectors, size = _principal(P)
    uncertain = values > KNOWN
    weights = jnp.where(uncertain, 1.0 / jnp.where(uncertain, values, 1.0), 0.0)
    scaled = vectors / size[:, None]
    return (scaled * weights[None]) @ scaled.T


def _principal(P: Float[Array, "n n"]) -> tuple[Float[Array, " n"], Float[Array, "n n"], Float[Array, " n"]]:
    """Eigenvalues and vectors of a covariance scaled to a diagonal of 1, and the scales."""
    size = jnp.sqrt(jnp.diagonal(P))
    size = jnp.where(size > 0, size, 1.0)
    values, vectors = jnp.linalg.eigh(P / size[:, None] / size[None])
    return values, vectors, size
