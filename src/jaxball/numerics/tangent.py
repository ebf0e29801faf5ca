"""Tangent dynamics: a state and small deviations from it, advanced together."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Field = Callable[[Float[Array, ""], Float[Array, " size"], Any], Float[Array, " size"]]
Normal = Callable[[Float[Array, " size"]], Float[Array, " size"]]


def tangent_field(field: Field) -> Callable[..., Float[Array, "rows size"]]:
    """The rates of x and of deviations δx from it: ẋ = f(t, x), δẋ = f′(t, x) δx.

    Row 0 of the matrix that it advances is x, and each of the others is a deviation. The products f′ δx come
    from forward-mode derivatives, and f′ is never formed.
    """

    def rates(t, rows, args):
        def along(deviation):
            return jax.jvp(lambda x: field(t, x, args), (rows[0],), (deviation,))

        rate, deviations = jax.vmap(along, out_axes=(None, 0))(rows[1:])
        return jnp.concatenate([rate[None], deviations])

    return rates


def largest_row(rows: Float[Array, "rows size"]) -> Float[Array, ""]:
    """The root mean square of the worst row: x and each deviation are kept to the tolerances, not their mean."""
    return jnp.sqrt(jnp.max(jnp.mean(rows**2, axis=1)))


def orthonormalised(vectors: Float[Array, "k size"]) -> tuple[Float[Array, "k size"], Float[Array, " k"]]:
    """Orthonormal rows that span the same subspaces, and the length of each row orthogonal to those before it.

    Modified Gram–Schmidt. For a few vectors it takes a tenth of the time of a library's QR factorisation, and the loss
    of orthogonality, the condition number times the rounding error, is negligible after a short interval.
    """
    rest, rows, lengths = vectors, [], []
    for _ in range(vectors.shape[0]):
        lengths.append(jnp.sqrt(jnp.sum(rest[0] ** 2)))
        rows.append(rest[0] / lengths[-1])
        rest = rest[1:] - jnp.sum(rest[1:] * rows[-1][None], axis=1)[:, None] * rows[-1][None]
    return jnp.stack(rows), jnp.stack(lengths)


def without_normal(
    vectors: Float[Array, "k size"], x: Float[Array, " size"], normal: Normal | None
) -> Float[Array, "k size"]:
    """``vectors`` without their components along the normal at ``x``."""
    if normal is None:
        return vectors
    n = normal(x)
    return vectors - (jnp.sum(vectors * n[None], axis=1) / jnp.sum(n**2))[:, None] * n[None]


def generic_vectors(count: int, size: int) -> np.ndarray:
    """Fixed vectors that do not lie in a subspace which a symmetry of a flow could single out."""
    return np.random.default_rng(0).normal(size=(count, size))
