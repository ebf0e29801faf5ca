"""Linear systems of a few unknowns, several at once, within a loop."""

from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Inexact, Int

# Above this size a library's factorisation is faster; below, its call costs more than the work.
LARGEST_SMALL = 32


def product(A: Inexact[Array, "m n"], B: Inexact[Array, "n k"]) -> Inexact[Array, "m k"]:
    """``A @ B``, as a sum."""
    return jnp.sum(A[:, :, None] * B[None], axis=1)


def solutions(inverses: Float[Array, "#k n n"], b: Float[Array, "k n"]) -> Float[Array, "k n"]:
    """The solutions of k systems by their inverses, or one that they share, each with its own right-hand side."""
    return jnp.sum(inverses * b[:, None, :], axis=2)


def inverses(matrices: Float[Array, "k n n"]) -> Float[Array, "k n n"]:
    """The inverses of matrices; that of a singular one has entries that are not finite."""
    if matrices.shape[1] > LARGEST_SMALL:
        return jnp.linalg.inv(matrices)
    return _eliminated((matrices,))[0]


def complex_inverses(
    real: Float[Array, "k n n"], imaginary: Float[Array, "k n n"]
) -> tuple[Float[Array, "k n n"], Float[Array, "k n n"]]:
    """The same of complex matrices, by their real and imaginary parts."""
    if real.shape[1] > LARGEST_SMALL:
        inverse = jnp.linalg.inv(jax.lax.complex(real, imaginary))
        return inverse.real, inverse.imag
    inverse = _eliminated((real, imaginary))
    return inverse[0], inverse[1]


# The real part of a number, and the imaginary one if it is complex.
_Parts: TypeAlias = tuple[Array, ...]


def _eliminated(matrices: _Parts) -> _Parts:
    """The inverses by Gauss–Jordan elimination with partial pivoting, in place and without a library call.

    Each turn eliminates the first column by the first row, after an exchange of rows, and moves both to the end, so
    that every index is known while compiling.
    """
    k, n, _ = matrices[0].shape
    index = jnp.arange(n)

    def eliminate(turn, carry):
        B, rows = carry
        size = sum(part[:, :, 0] * part[:, :, 0] for part in B)
        pivot = jnp.argmax(jnp.where(index < n - turn, size, -1.0), axis=1)
        here = pivot[:, None] == index[None]
        chosen, rest = zip(*(_exchanged(part, here) for part in B), strict=True)
        first = _reciprocal(tuple(part[:, :1] for part in chosen))
        row = _product(tuple(part[:, 1:] for part in chosen), first)
        row = tuple(jnp.concatenate([part, last], axis=1) for part, last in zip(row, first, strict=True))
        change = _product(tuple(part[:, :, :1] for part in rest), tuple(part[:, None] for part in row))
        others = (jnp.pad(part[:, :, 1:], ((0, 0), (0, 0), (0, 1))) for part in rest)
        B = tuple(
            jnp.concatenate([part - less, last[:, None]], axis=1)
            for part, less, last in zip(others, change, row, strict=True)
        )
        number, others = _exchanged(rows[:, :, None], here)
        return B, jnp.concatenate([others[:, :, 0], number], axis=1)

    start = jnp.broadcast_to(index, (k, n))
    B, rows = jax.lax.fori_loop(0, n, eliminate, (matrices, start))
    # Column j belongs to the row from which the pivot of turn j came.
    return tuple(_with_columns(part, rows) for part in B)


def _exchanged(B: Array, here: Bool[Array, "k n"]) -> tuple[Array, Array]:
    """The row that is ``here``, and all others below the first, which takes its place."""
    chosen = jnp.sum(jnp.where(here[:, :, None], B, 0), axis=1)
    return chosen, jnp.where(here[:, 1:, None], B[:, :1], B[:, 1:])


def _with_columns(B: Float[Array, "k n n"], places: Int[Array, "k n"]) -> Float[Array, "k n n"]:
    """B with each column at its place."""

    def add(place, found):
        column = jnp.sum(jnp.where((places == place)[:, None], B, 0.0), axis=2, keepdims=True)
        return jnp.concatenate([found[:, :, 1:], column], axis=2)

    return jax.lax.fori_loop(0, B.shape[1], add, jnp.zeros_like(B))


def _product(x: _Parts, y: _Parts) -> _Parts:
    if len(x) == 1:
        return (x[0] * y[0],)
    return x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]


def _reciprocal(x: _Parts) -> _Parts:
    if len(x) == 1:
        return (1 / x[0],)
    size = x[0] * x[0] + x[1] * x[1]
    return x[0] / size, -x[1] / size


class Factors(NamedTuple):
    """A = L D Lᵀ, with ones on the diagonal of L."""

    lower: Float[Array, "k k"]  # L; what is above its diagonal is 0
    pivots: Float[Array, " k"]  # the diagonal of D, all positive where A is positive definite

    def reduced(self, b: Float[Array, "k *columns"]) -> Float[Array, "k *columns"]:
        """L⁻¹ b."""
        rows: list[Array] = []
        for i in range(len(self.pivots)):
            rows.append(b[i] - sum((self.lower[i, j] * row for j, row in enumerate(rows)), jnp.zeros_like(b[i])))
        return jnp.stack(rows)

    def divided(self, y: Float[Array, "k *columns"]) -> Float[Array, "k *columns"]:
        """D⁻¹ y."""
        return jnp.stack([row / pivot for row, pivot in zip(y, self.pivots, strict=True)])

    def completed(self, y: Float[Array, "k *columns"]) -> Float[Array, "k *columns"]:
        """L⁻ᵀ y."""
        rows: list[Array] = []
        for i in reversed(range(len(self.pivots))):
            later = (self.lower[j, i] * row for j, row in zip(range(i + 1, len(self.pivots)), rows, strict=True))
            rows.insert(0, y[i] - sum(later, jnp.zeros_like(y[i])))
        return jnp.stack(rows)


def factored(A: Float[Array, "k k"]) -> Factors:
    """The factors of a symmetric matrix, of which only the lower half is read; not finite where it is singular."""
    k = A.shape[0]
    zero, one = jnp.zeros_like(A[0, 0]), jnp.ones_like(A[0, 0])
    L: list[list[Array]] = [[zero] * i + [one] + [zero] * (k - i - 1) for i in range(k)]
    d: list[Array] = []
    for i in range(k):
        for j in range(i):
            L[i][j] = (A[i, j] - sum((L[i][m] * L[j][m] * d[m] for m in range(j)), zero)) / d[j]
        d.append(A[i, i] - sum((L[i][m] ** 2 * d[m] for m in range(i)), zero))
    return Factors(jnp.stack([jnp.stack(row) for row in L]), jnp.stack(d))


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
