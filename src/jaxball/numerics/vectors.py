"""Products of three-vectors and small matrices, written so that a compiled loop stays one function.

``jnp.dot`` and ``jnp.linalg.solve`` become library calls, and one such call inside a loop's body
keeps XLA's CPU compiler from fusing that body. These are sums and products of elements only.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float


def dot(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, ""]:
    """The scalar product a · b."""
    return jnp.sum(a * b)


def cross(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, "3"]:
    """The vector product a × b."""
    return jnp.stack(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


def outer(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The dyad a bᵀ."""
    return a[:, None] * b[None, :]


def apply(A: Float[Array, "3 3"], b: Float[Array, "3"]) -> Float[Array, "3"]:
    """The product A b."""
    return jnp.sum(A * b[None, :], axis=1)


def hat(a: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The antisymmetric matrix â with â b = a × b."""
    zero = jnp.zeros_like(a[0])
    return jnp.stack(
        [
            jnp.stack([zero, -a[2], a[1]]),
            jnp.stack([a[2], zero, -a[0]]),
            jnp.stack([-a[1], a[0], zero]),
        ]
    )


def inverse(A: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """A⁻¹ by cofactors; not finite where A is singular."""
    c0, c1, c2 = cross(A[1], A[2]), cross(A[2], A[0]), cross(A[0], A[1])
    return jnp.stack([c0, c1, c2], axis=1) / dot(A[0], c0)


def solve(A: Float[Array, "3 3"], b: Float[Array, "3"]) -> Float[Array, "3"]:
    """The solution x of A x = b by Cramer's rule; not finite where A is singular."""
    c0, c1, c2 = cross(A[1], A[2]), cross(A[2], A[0]), cross(A[0], A[1])
    return (c0 * b[0] + c1 * b[1] + c2 * b[2]) / dot(A[0], c0)
