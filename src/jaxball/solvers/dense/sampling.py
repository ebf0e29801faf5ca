"""Functions of time within steps, by the polynomials through a few of their values."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

NODES = 5
FINENESS = 32
# The half width of the next window, relative to this one: a few times the error of a quartic.
NARROWER = 1 / 12


class Sampling(NamedTuple):
    """Where in a step a function is evaluated: the Gauss–Lobatto fractions of it, which include both ends.

    ``matrix`` takes the values at these nodes to those of the polynomial through them at the ``fractions``, among
    which the nodes are; ``powers`` takes them to its coefficients, the lowest first, with the step as unit of time.
    """

    nodes: np.ndarray
    fractions: np.ndarray
    matrix: np.ndarray
    powers: np.ndarray

    def polynomials(self, samples: Float[Array, "*steps nodes"]) -> Float[Array, "*steps fractions"]:
        """The values of the polynomials at the fractions; exact at the nodes."""
        return jnp.einsum("...n,fn->...f", samples, jnp.asarray(self.matrix, samples.dtype))

    def value(self, samples: Float[Array, "*steps nodes"], fraction: Float[Array, "*steps"]) -> Float[Array, "*steps"]:
        """The polynomials at any fraction."""
        a0, a1, a2, a3, a4 = jnp.einsum("...n,mn->m...", samples, jnp.asarray(self.powers, samples.dtype))
        u = fraction
        return a0 + u * (a1 + u * (a2 + u * (a3 + u * a4)))

    def rates(
        self, samples: Float[Array, "*steps nodes"], fraction: Float[Array, "*steps"]
    ) -> tuple[Float[Array, "*steps"], Float[Array, "*steps"]]:
        """The first and the second derivative of the polynomials at any fraction."""
        _, a1, a2, a3, a4 = jnp.einsum("...n,mn->m...", samples, jnp.asarray(self.powers, samples.dtype))
        u = fraction
        return a1 + u * (2 * a2 + u * (3 * a3 + u * 4 * a4)), 2 * a2 + u * (6 * a3 + u * 12 * a4)

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
    return Sampling(nodes, fractions, matrix, np.linalg.inv(np.vander(nodes, increasing=True)))


@cache
def lobatto_weights() -> np.ndarray:
    """The weights of the nodes that integrate every polynomial of degree 4 exactly, and by symmetry of degree 7."""
    nodes = sampling().nodes
    powers = np.arange(nodes.size)
    return np.linalg.solve(nodes[None, :] ** powers[:, None], 1 / (powers + 1))


def last_within(start: Float[Array, "*steps"], end: Float[Array, "*steps"]) -> Float[Array, "*steps"]:
    """The last time of a step: a little before its end, so that a kink there is seen from before."""
    return jnp.maximum(start, end - 4 * float(np.finfo(end.dtype).eps) * jnp.abs(end))


def place_of_largest(
    value: Callable[[Float[Array, ""]], Float[Array, ""]],
    first: Float[Array, ""],
    last: Float[Array, ""],
    rounds: int,
) -> Float[Array, ""]:
    """Where a function of time is largest between ``first`` and ``last``, by quartics in ever narrower windows.

    Where a value in a window is not finite, the time before stays, which at first is ``first``.
    """
    at = sampling()
    nodes, fractions, matrix = (jnp.asarray(x, first.dtype) for x in (at.nodes, at.fractions, at.matrix))

    def narrower(_, carry):
        t, half = carry
        low, high = jnp.maximum(t - half, first), jnp.minimum(t + half, last)
        samples = jax.lax.map(lambda node: value(low + node * (high - low)), nodes)
        fine = jnp.sum(matrix * samples[None], axis=1)
        # The first of the largest, without argmax, at which XLA's CPU compiler fails in a loop.
        best = low + (high - low) * jnp.min(jnp.where(fine == jnp.max(fine), fractions, jnp.inf))
        return jnp.where(jnp.all(jnp.isfinite(samples)), best, t), half * NARROWER

    return jax.lax.fori_loop(0, rounds, narrower, (first, last - first))[0]


def _lagrange(nodes: np.ndarray, k: int, x: float) -> float:
    others = np.delete(nodes, k)
    return float(np.prod((x - others) / (nodes[k] - others)))
