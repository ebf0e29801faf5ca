"""Linear systems of a few unknowns, several at once, within a loop."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Inexact

# Above this size a library's factorisation is faster than ours; below, the call of it costs more than the work.
LARGEST_SMALL = 32


def product(A: Inexact[Array, "m n"], B: Inexact[Array, "n k"]) -> Inexact[Array, "m k"]:
    """``A @ B``, as a sum."""
    return jnp.sum(A[:, :, None] * B[None], axis=1)


def solutions(inverses: Inexact[Array, "#k n n"], b: Inexact[Array, "k n"]) -> Inexact[Array, "k n"]:
    """The solutions of k systems by their inverses, or one that they share, each with its own right-hand side."""
    return jnp.sum(inverses * b[:, None, :], axis=2)


def inverses(matrices: Inexact[Array, "k n n"]) -> Inexact[Array, "k n n"]:
    """The inverses of matrices; that of a singular one has entries that are not finite.

    By Gauss and Jordan with partial pivoting, in place and without a call of a library where the matrices are small.
    Rows are not exchanged: the row of each column's pivot is remembered, and rows and columns are put in
    order at the end.
    """
    k, n, _ = matrices.shape
    if n > LARGEST_SMALL:
        return jnp.linalg.inv(matrices)
    index = jnp.arange(n)

    def eliminate(j, carry):
        B, used, pivots = carry
        column = jax.lax.dynamic_index_in_dim(B, j, axis=2, keepdims=False)
        size = (column * column.conj()).real
        pivot = jnp.argmax(jnp.where(used, -1.0, size), axis=1)
        is_pivot, here = pivot[:, None] == index[None], (index == j)[None]
        row = jnp.take_along_axis(B, pivot[:, None, None], axis=1)[:, 0]
        row = jnp.where(here, 1.0, row) / jnp.take_along_axis(row, jnp.full((k, 1), j), axis=1)
        others = jnp.where(here[:, None], 0.0, B) - column[:, :, None] * row[:, None, :]
        B = jnp.where(is_pivot[:, :, None], row[:, None, :], others)
        return B, used | is_pivot, jax.lax.dynamic_update_index_in_dim(pivots, pivot, j, axis=1)

    start = (matrices, jnp.zeros((k, n), bool), jnp.zeros((k, n), index.dtype))
    B, _, pivots = jax.lax.fori_loop(0, n, eliminate, start)
    B = jnp.take_along_axis(B, pivots[:, :, None], axis=1)
    # The column that belongs to row i is the one whose pivot was in row i.
    columns = jnp.sum(jnp.where(pivots[:, :, None] == index[None, None], index[None, :, None], 0), axis=1)
    return jnp.take_along_axis(B, columns[:, None, :], axis=2)
