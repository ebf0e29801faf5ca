"""Least squares without library calls, which block one another when programs run side by side."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def least_squares(matrix: Float[Array, "rows n"], wanted: Float[Array, " rows"]) -> Float[Array, " n"]:
    """The x with the least |matrix x − wanted|, for a matrix of full column rank.

    Modified Gram–Schmidt on the columns of the matrix, which is as stable as Householder's method if the right-hand
    side is treated as an additional column (Björck 1967).
    """
    rest, n, rows, right = jnp.concatenate([matrix, wanted[:, None]], axis=1), matrix.shape[1], [], []
    for _ in range(n):
        length = jnp.sqrt(jnp.sum(rest[:, 0] ** 2))
        unit = rest[:, :1] / length
        along = jnp.sum(unit * rest[:, 1:], axis=0)
        rest = rest[:, 1:] - unit * along[None]
        rows.append(jnp.concatenate([length[None], along[:-1]]))
        right.append(along[-1])
    x = jnp.zeros((0,), matrix.dtype)
    for row, value in zip(reversed(rows), reversed(right), strict=True):
        x = jnp.concatenate([((value - jnp.sum(row[1:] * x)) / row[0])[None], x])
    return x
