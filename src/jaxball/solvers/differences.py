"""Modified divided differences of slopes at the last points, and integrals of the polynomial through them.

Slopes f_n, f_{n−1}, … at the points t_n, t_{n−1}, … have the differences

    Φ_j(n) = (t_n − t_{n−1}) (t_n − t_{n−2}) ⋯ (t_n − t_{n−j}) δʲf[t_n, …, t_{n−j}],

with δʲ the divided difference of order j, so that Φ_0 is f_n, and for equal steps Φ_j is the backward difference ∇ʲf_n.
At t_{n+1} they are Φ_0 = f_{n+1} and Φ_{j+1}(n+1) = Φ_j(n+1) − β_j Φ_j(n): this is how they are advanced, and how a
polynomial is extrapolated, whose value there is Σ β_j Φ_j(n).

Krogh, *Changing stepsize in the integration of differential equations using modified divided differences*, Lecture
Notes in Mathematics 362 (1974) 22–71; Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I* (1993),
section III.5, from where the names β, Φ and g are.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Points(NamedTuple):
    """The points behind a step of length ``h``: ``past`` are the times from each of them to the step's start.

    The last point is the start itself, ``past[0]`` = 0, or shortly before it.
    """

    past: Float[Array, " rows"]
    h: Float[Array, ""]

    def factors(self) -> Float[Array, " rows"]:
        """β_j, the product of (t − t_{n−i}) / (t_n − t_{n−1−i}) over i < j, with t the end of the step."""
        return products((self.h + self.past[:-1]) / (self.past[1:] - self.past[0]))

    def evenness(self) -> Float[Array, " rows"]:
        """j! hʲ over the product of t − t_{n−i} over i < j: 1 if all steps had the length h.

        It estimates what a difference would be with equal steps.
        """
        return products(jnp.arange(1, self.past.size, dtype=self.h.dtype) * self.h / (self.h + self.past[:-1]))

    def integrals(self, end: Float[Array, ""] | float = 1.0) -> Float[Array, " rows"]:
        """g_j, the integrals of the products of (s − t_{n−i}) / (t − t_{n−i}) over i < j, from 0 to ``end``, over h.

        In units of h; ``end`` is a fraction of the step. By Gauss's quadrature, exact for these polynomials, of terms
        that are all positive within the step.
        """
        nodes, weights = np.polynomial.legendre.leggauss(self.past.size // 2 + 1)
        nodes, weights = (jnp.asarray(x, self.h.dtype) for x in (0.5 + 0.5 * nodes, 0.5 * weights))
        past = self.past[:-1, None]
        polynomials = products((end * nodes[None] * self.h + past) / (self.h + past))
        return end * jnp.sum(weights[None] * polynomials, axis=1)

    def advanced(self) -> Float[Array, " rows"]:
        """``past`` of the next step."""
        return jnp.concatenate([jnp.zeros_like(self.past[:1]), self.h + self.past[:-1]])


def sums(rows: Float[Array, "rows n"]) -> Float[Array, "rows n"]:
    """The sums of all rows before each. As plain sums: a loop or a library call would cost more."""
    return jnp.sum(jnp.where(_before(len(rows), len(rows))[:, :, None], rows[None], 0.0), axis=1)


def products(factors: Float[Array, "count *n"]) -> Float[Array, "rows *n"]:
    """The products of all factors before each place, and of all of them: 1, a, ab, abc, …"""
    before = _before(len(factors) + 1, len(factors))
    return jnp.prod(jnp.where(before.reshape(*before.shape, *(1,) * (factors.ndim - 1)), factors[None], 1.0), axis=1)


def _before(rows: int, count: int) -> np.ndarray:
    """Which of so many places are before each row."""
    return np.arange(count) < np.arange(rows)[:, None]


def error_constants(rows: int) -> np.ndarray:
    """|γ*_j|: the error of the integral over a step by the formula with j points for equal steps, in units of h ∇ʲf.

    They are the coefficients of the Adams–Moulton formulas: Hairer, Nørsett & Wanner I, eqs. (III.1.11) and (III.1.12).
    """
    gamma = np.ones(rows)
    for j in range(1, rows):
        gamma[j] = -sum(gamma[i] / (j + 1 - i) for i in range(j))
    return np.abs(gamma)
