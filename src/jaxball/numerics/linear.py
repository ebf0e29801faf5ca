"""Linear systems of a few unknowns, several at once, within a loop."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Inexact, Int

# Above this size a library's factorisation is faster; below, its call costs more than the work.
LARGEST_SMALL = 32
# Numbers of the matrices whose rows are exchanged even where none needs it.
LARGEST_CHANGED = 64


def product(A: Inexact[Array, "m n"], B: Inexact[Array, "n k"]) -> Inexact[Array, "m k"]:
    """Computes ``A @ B``, as a sum."""
    return jnp.sum(A[:, :, None] * B[None], axis=1)


def solutions(inverses: Float[Array, "#k n n"], b: Float[Array, "k n"]) -> Float[Array, "k n"]:
    """Computes the solutions of k systems by their inverses, or one that they share, each with its own
    right-hand side.
    """
    return jnp.sum(inverses * b[:, None, :], axis=2)


def inverses(matrices: Float[Array, "k n n"]) -> Float[Array, "k n n"]:
    """Computes the inverses of matrices; the inverse of a singular one has entries that are not finite."""
    if matrices.shape[1] > LARGEST_SMALL:
        return jnp.linalg.inv(matrices)
    return _invert_by_elimination((matrices,))[0]


@jax.custom_jvp
def inverse(A: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """Computes the inverse of one matrix, whose derivatives, of any order and in both modes, follow from −A⁻¹ dA A⁻¹.

    So reverse mode goes through products, and not back through the elimination.
    """
    return inverses(A[None])[0]


@inverse.defjvp
def _inverse_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    inverse_matrix = inverse(*primals)
    return inverse_matrix, -product(product(inverse_matrix, tangents[0]), inverse_matrix)


def complex_inverses(
    real: Float[Array, "k n n"], imaginary: Float[Array, "k n n"]
) -> tuple[Float[Array, "k n n"], Float[Array, "k n n"]]:
    """Computes the inverses of complex matrices, by their real and imaginary parts."""
    if real.shape[1] > LARGEST_SMALL:
        inverse = jnp.linalg.inv(jax.lax.complex(real, imaginary))
        return inverse.real, inverse.imag
    inverse = _invert_by_elimination((real, imaginary))
    return inverse[0], inverse[1]


# The real part of a number, and the imaginary one if it is complex.
_Parts: TypeAlias = tuple[Array, ...]


def _invert_by_elimination(matrices: _Parts) -> _Parts:
    """Computes the inverses by Gauss–Jordan elimination with partial pivoting, in place and without a library call.

    Each turn eliminates the first column by the first row, and moves both to the end, so that every index is known
    while compiling. Rows of more than a few numbers are exchanged only in a turn in which a matrix needs it.
    """
    k, n, _ = matrices[0].shape
    index = jnp.arange(n)

    def eliminate(turn, carry):
        size = sum(part[:, :, 0] * part[:, :, 0] for part in carry[0])
        # Rows that were eliminated are at the end, and no pivots any more.
        pivot = jnp.argmax(jnp.where(index < n - turn, size, -1.0), axis=1)
        B, rows = _if_any(pivot > 0, _exchange, carry, pivot)
        first = _reciprocal(tuple(part[:, :1, 0] for part in B))
        row = _product(tuple(part[:, 0, 1:] for part in B), first)
        row = tuple(jnp.concatenate([part, last], axis=1) for part, last in zip(row, first, strict=True))
        change = _product(tuple(part[:, 1:, :1] for part in B), tuple(part[:, None] for part in row))
        others = (jnp.pad(part[:, 1:, 1:], ((0, 0), (0, 0), (0, 1))) for part in B)
        B = tuple(
            jnp.concatenate([part - less, last[:, None]], axis=1)
            for part, less, last in zip(others, change, row, strict=True)
        )
        return B, jnp.roll(rows, -1, axis=1)

    start = jnp.broadcast_to(index, (k, n))
    B, rows = jax.lax.fori_loop(0, n, eliminate, (matrices, start))
    # Column j belongs to the row from which the pivot of turn j came.
    return _if_any(rows != start, _with_columns, B, rows)


def _if_any(needed: Bool[Array, "..."], change: Callable[..., Any], before: Any, *others: Any) -> Any:
    """Applies ``change`` where it is needed, or returns ``before``; for a few numbers always, because a branch costs
    more.
    """
    if sum(part.size for part in jax.tree.leaves(before)) <= LARGEST_CHANGED:
        return change(before, *others)
    return jax.lax.cond(jnp.any(needed), change, lambda before, *others: before, before, *others)


def _exchange(carry: tuple[_Parts, Int[Array, "k n"]], pivot: Int[Array, " k"]) -> tuple[_Parts, Int[Array, "k n"]]:
    """Returns the matrices and the numbers of their rows, with the row ``pivot`` as the first, and the first in its
    place.
    """
    here = pivot[:, None] == jnp.arange(carry[1].shape[1])[None]

    def exchange(B: Array) -> Array:
        chosen = jnp.sum(jnp.where(here[:, :, None], B, 0), axis=1, keepdims=True)
        return jnp.concatenate([chosen, jnp.where(here[:, 1:, None], B[:, :1], B[:, 1:])], axis=1)

    return tuple(map(exchange, carry[0])), exchange(carry[1][:, :, None])[:, :, 0]


def _with_columns(B: _Parts, places: Int[Array, "k n"]) -> _Parts:
    """Returns B with each column at its place."""

    def add(place, columns):
        def with_column(part, columns):
            column = jnp.sum(jnp.where((places == place)[:, None], part, 0.0), axis=2, keepdims=True)
            return jnp.concatenate([columns[:, :, 1:], column], axis=2)

        return tuple(map(with_column, B, columns))

    return jax.lax.fori_loop(0, places.shape[1], add, tuple(map(jnp.zeros_like, B)))


def _product(x: _Parts, y: _Parts) -> _Parts:
    if len(x) == 1:
        return (x[0] * y[0],)
    return x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]


def _reciprocal(x: _Parts) -> _Parts:
    if len(x) == 1:
        return (1 / x[0],)
    size = x[0] * x[0] + x[1] * x[1]
    return x[0] / size, -x[1] / size


def tridiagonal_solution(
    lower: Float[Array, " n"], diagonal: Float[Array, " n"], upper: Float[Array, " n"], b: Float[Array, " n"]
) -> Float[Array, " n"]:
    """Solves lower_i x_(i−1) + diagonal_i x_i + upper_i x_(i+1) = b_i for x, where lower_0 and upper_(n−1) are 0.

    Gaussian elimination without pivoting, which is stable where each diagonal entry exceeds the others of its row.
    """

    def eliminate(carry, row):
        ratio, reduced = carry
        below, centre, above, right = row
        pivot = centre - below * ratio
        carry = above / pivot, (right - below * reduced) / pivot
        return carry, carry

    def substitute(x, row):
        ratio, reduced = row
        x = reduced - ratio * x
        return x, x

    zero = jnp.zeros_like(b[0])
    _, rows = jax.lax.scan(eliminate, (zero, zero), (lower, diagonal, upper, b))
    return jax.lax.scan(substitute, zero, rows, reverse=True)[1]


class Factors(NamedTuple):
    """A = L D Lᵀ, with ones on the diagonal of L."""

    lower: Float[Array, "k k"]  # L; what is above its diagonal is 0
    pivots: Float[Array, " k"]  # the diagonal of D, all positive where A is positive definite

    def solve_lower(self, b: Float[Array, "k *columns"]) -> Float[Array, "k *columns"]:
        """Computes L⁻¹ b."""
        rows: list[Array] = []
        for i in range(len(self.pivots)):
            rows.append(b[i] - sum((self.lower[i, j] * row for j, row in enumerate(rows)), jnp.zeros_like(b[i])))
        return jnp.stack(rows)

    def divide_by_pivots(self, y: Float[Array, "k *columns"]) -> Float[Array, "k *columns"]:
        """Computes D⁻¹ y."""
        return jnp.stack([row / pivot for row, pivot in zip(y, self.pivots, strict=True)])

    def solve_upper(self, y: Float[Array, "k *columns"]) -> Float[Array, "k *columns"]:
        """Computes L⁻ᵀ y."""
        rows: list[Array] = []
        for i in reversed(range(len(self.pivots))):
            later = (self.lower[j, i] * row for j, row in zip(range(i + 1, len(self.pivots)), rows, strict=True))
            rows.insert(0, y[i] - sum(later, jnp.zeros_like(y[i])))
        return jnp.stack(rows)


def factor_symmetric(A: Float[Array, "k k"]) -> Factors:
    """Computes the factors of a symmetric matrix, of which only the lower half is read; not finite where it is
    singular.
    """
    k = A.shape[0]
    zero, unit = jnp.zeros_like(A[0, 0]), jnp.ones_like(A[0, 0])
    L: list[list[Array]] = [[zero] * i + [unit] + [zero] * (k - i - 1) for i in range(k)]
    d: list[Array] = []
    for i in range(k):
        for j in range(i):
            L[i][j] = (A[i, j] - sum((L[i][m] * L[j][m] * d[m] for m in range(j)), zero)) / d[j]
        d.append(A[i, i] - sum((L[i][m] ** 2 * d[m] for m in range(i)), zero))
    return Factors(jnp.stack([jnp.stack(row) for row in L]), jnp.stack(d))


def least_squares(matrix: Float[Array, "rows n"], wanted: Float[Array, " rows"]) -> Float[Array, " n"]:
    """Finds the x with the least |matrix x − wanted|, for a matrix of full column rank.

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
