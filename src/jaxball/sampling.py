"""Functions of time within steps, by the polynomials through a few of their values."""

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

NODES = 5
FINENESS = 32


class Sampling(NamedTuple):
    """Where in a step a function is looked at: fractions of it, those of Gauss–Lobatto, which hold both ends.

    ``matrix`` takes the values at these nodes to those of the polynomial through them at the ``fractions``, among
    which the nodes are.
    """

    nodes: np.ndarray
    fractions: np.ndarray
    matrix: np.ndarray

    def polynomials(self, samples: Float[Array, "*steps nodes"]) -> Float[Array, "*steps fractions"]:
        """The values of the polynomials at the fractions; exact at the nodes."""
        return jnp.einsum("...n,fn->...f", samples, jnp.asarray(self.matrix, samples.dtype))

    def times(
        self, t0: Float[Array, "*steps"], t1: Float[Array, "*steps"], fractions: np.ndarray
    ) -> Float[Array, "*steps fractions"]:
        """The times at some fractions of steps."""
        parts = jnp.asarray(fractions, t0.dtype).reshape((1,) * t0.ndim + (-1,))
        return t0[..., None] + (t1 - t0)[..., None] * parts


@cache
def sampling() -> Sampling:
    """The nodes of Gauss–Lobatto, the zeros of (1 − x²) P′, and 32 equal parts of a step."""
    inner = np.real(np.polynomial.legendre.Legendre.basis(NODES - 1).deriv().roots())
    nodes = np.concatenate([[0.0], 0.5 + 0.5 * inner, [1.0]])
    fractions = np.union1d(nodes, np.linspace(0.0, 1.0, FINENESS + 1))
    matrix = np.array([[_lagrange(nodes, k, x) for k in range(NODES)] for x in fractions])
    return Sampling(nodes, fractions, matrix)


def _lagrange(nodes: np.ndarray, k: int, x: float) -> float:
    others = np.delete(nodes, k)
    return float(np.prod((x - others) / (nodes[k] - others)))
