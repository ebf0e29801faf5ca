"""The factors of small symmetric positive definite matrices, written as sums and products of elements.

``vectors`` explains why no library is called.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


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
