"""The Riccati recursion of a linear quadratic regulator over a finite horizon, in square-root form, for ``track``.

The cost-to-go of a deviation ξ from a motion is |S (ξ, 1)|², with S upper triangular. It follows from that of the next
sample by a QR factorisation, without subtraction and without the inverse of anything but a triangle that the weights of
the inputs keep regular; so S may be singular, where deviations cost nothing. Source: Kailath, Sayed & Hassibi, *Linear
Estimation* (2000), chapter 12, for the filter that is dual to it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .sampled import Linear


class Regulator(NamedTuple):
    """The best feedback of each sample, δu = −K ξ − k, and its cost-to-go.

    - ``K``, ``k``: shapes (N, m, n) and (N, m).
    - ``P``: of (ξ, 1), symmetric: the cost from each sample on is (ξ, 1)·P (ξ, 1), shape (N + 1, n + 1, n + 1).
    """

    K: Float[Array, "samples m n"]
    k: Float[Array, "samples m"]
    P: Float[Array, "samples_and_end n_plus_one n_plus_one"]


def regulator(linear: Linear, W: Float[Array, "rows n_plus_m"], S: Float[Array, "n_plus_one n_plus_one"]) -> Regulator:
    """Computes the regulator with the least Σ |W (ξ, δu)|² + |S (ξ, 1)|² at the end, for ξ⁺ = A ξ + B δu + c.

    ``WᵀW`` must be positive definite in δu. It can be differentiated in both modes.
    """
    A, B = _homogeneous(linear)
    gains, P = _solve_backward(A, B, W, S)
    return Regulator(gains[..., :-1], gains[..., -1], P)


def stationary(linear: Linear, W: Float[Array, "rows n_plus_m"], samples: int) -> Float[Array, "n_plus_one n_plus_one"]:
    """Computes S at the start of ``samples`` samples of one linear flow, without its c: near its limit, if there are
    enough.
    """
    # With c, which the motion itself misses, the cost would grow with every repeated sample; without it there is a
    # limit.
    A, B = _homogeneous(linear._replace(c=jnp.zeros_like(linear.c)))
    n = linear.A.shape[-1]
    end = jnp.zeros((n + 1, n + 1), A.dtype)

    def step(S, _):
        return _previous(A, B, W, S)[1], None

    return jax.lax.scan(step, end, length=samples)[0]


def _homogeneous(linear: Linear) -> tuple[Array, Array]:
    """Returns A and B of (ξ, 1)."""
    A, B, c = linear
    below = jnp.zeros_like(A[..., :1, :])
    last = jnp.concatenate([below, below[..., :1] + 1], axis=-1)
    A = jnp.concatenate([jnp.concatenate([A, c[..., None]], axis=-1), last], axis=-2)
    return A, jnp.concatenate([B, jnp.zeros_like(B[..., :1, :])], axis=-2)


def _previous(A: Array, B: Array, W: Array, S: Array) -> tuple[Array, Array]:
    """Computes the gain of a sample, and S at its start, from S at its end."""
    size, m = B.shape
    # Inputs come first, so that the triangle's first rows have the gain, and the rest of it is S.
    now = jnp.concatenate([W[:, size - 1 :], W[:, : size - 1], jnp.zeros_like(W[:, :1])], axis=1)
    stacked = jnp.concatenate([now, jnp.concatenate([S @ B, S @ A], axis=1)])
    triangle = jnp.linalg.qr(stacked, mode="r")
    gain = jax.scipy.linalg.solve_triangular(triangle[:m, :m], triangle[:m, m:])
    return gain, triangle[m:, m:]


@jax.custom_jvp
def _solve_backward(A: Array, B: Array, W: Array, S: Array) -> tuple[Array, Array]:
    """Computes the gains of all samples, and P = SᵀS at each and at the end."""

    def step(S, sample):
        A, B = sample
        gain, before = _previous(A, B, W, S)
        return before, (gain, before.T @ before)

    gains, P = jax.lax.scan(step, S, (A, B), reverse=True)[1]
    return gains, jnp.concatenate([P, (S.T @ S)[None]])


@_solve_backward.defjvp
def _derivative(primals, tangents):
    """Differentiates by the recursion for P itself, in Joseph's form: a triangle that is singular has no
    derivatives.
    """
    return _solve_backward(*primals), jax.jvp(_by_joseph, primals, tangents)[1]


def _by_joseph(A: Array, B: Array, W: Array, S: Array) -> tuple[Array, Array]:
    size = A.shape[-1]
    # The constant 1, the last component, has no weight of its own.
    Wx = jnp.concatenate([W[:, : size - 1], jnp.zeros_like(W[:, :1])], axis=1)
    Wu = W[:, size - 1 :]

    def step(P, sample):
        A, B = sample
        gain = jnp.linalg.solve(Wu.T @ Wu + B.T @ P @ B, Wu.T @ Wx + B.T @ P @ A)
        closed, cost = A - B @ gain, Wx - Wu @ gain
        before = closed.T @ P @ closed + cost.T @ cost
        return before, (gain, before)

    end = S.T @ S
    gains, P = jax.lax.scan(step, end, (A, B), reverse=True)[1]
    return gains, jnp.concatenate([P, end[None]])
