"""Differences of what a multistep method keeps of its last points, and the formulas made of them.

**Modified divided differences**, by which ``adams`` advances a solve. Slopes f_n, f_{n−1}, … at the points t_n,
t_{n−1}, … have the differences

    Φ_j(n) = (t_n − t_{n−1}) (t_n − t_{n−2}) ⋯ (t_n − t_{n−j}) δʲf[t_n, …, t_{n−j}],

with δʲ the divided difference of order j, so that Φ_0 is f_n, and for equal steps Φ_j is the backward difference ∇ʲf_n.
At t_{n+1} they are Φ_0 = f_{n+1} and Φ_{j+1}(n+1) = Φ_j(n+1) − β_j Φ_j(n): this is how they are advanced, and how a
polynomial is extrapolated, whose value there is Σ β_j Φ_j(n).

**Backward differences** of states at equal distances, by which ``ndf`` does: ∇⁰x_n = x_n and
∇ʲ⁺¹x_n = ∇ʲx_n − ∇ʲx_{n−1}. The polynomial of degree k through x_n, x_{n−1}, …, x_{n−k} is

    P(t_n + s H) = Σⱼ ∇ʲx_n s (s + 1) ⋯ (s + j − 1)/j!,    j = 0 … k,

with H the distance of the points. The formulas of Klopfenstein and Shampine set its derivative at the end of a step,
corrected by a multiple of the prediction error, equal to the slope there:

    Σⱼ ∇ʲx_{n+1}/j − κ γ_k (x_{n+1} − P(t_{n+1})) = h f(t_{n+1}, x_{n+1}),    j = 1 … k,

with γ_k = 1 + ½ + … + 1/k. With κ = 0 they are those of Curtiss and Hirschfelder (BDF).

Krogh, *Changing stepsize in the integration of differential equations using modified divided differences*, Lecture
Notes in Mathematics 362 (1974) 22–71; Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I* (1993),
section III.5, from where the names β, Φ and g are, and eqs. (5.10) on; Shampine & Reichelt, *The MATLAB ODE Suite*,
SIAM J. Sci. Comput. 18 (1997) 1–22, section 2, with the values of κ in table 1.
"""

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

# Components in a vector, and how many of them are not worth one.
COMPONENTS_OF_VECTOR, FEW_COMPONENTS = 8, 2
HIGHEST_BDF = 5
Kappa = Literal["ndf", "bdf"]
# From order 0. That of order 5 is zero, because the stability region would become too small.
KAPPAS: dict[str, np.ndarray] = {
    "ndf": np.array([0.0, -0.1850, -1 / 9, -0.0823, -0.0415, 0.0]),
    "bdf": np.zeros(HIGHEST_BDF + 1),
}
HARMONIC_SUMS = np.concatenate([[0.0], np.cumsum(1 / np.arange(1, HIGHEST_BDF + 1))])


class Points(NamedTuple):
    """The points behind a step of length ``h``: ``past`` are the times from each of them to the step's start.

    The last point is the start itself, ``past[0]`` = 0, or shortly before it.
    """

    past: Float[Array, " rows"]
    h: Float[Array, ""]

    def factors(self) -> Float[Array, " rows"]:
        """Computes β_j, the product of (t − t_{n−i}) / (t_n − t_{n−1−i}) over i < j, with t the end of the step."""
        return products((self.h + self.past[:-1]) / (self.past[1:] - self.past[0]))

    def evenness(self) -> Float[Array, " rows"]:
        """Computes j! hʲ over the product of t − t_{n−i} over i < j: 1 if all steps had the length h.

        It estimates what a difference would be with equal steps.
        """
        return products(jnp.arange(1, self.past.size, dtype=self.h.dtype) * self._shares())

    def integrals(self, end: Float[Array, ""] | None = None) -> Float[Array, " rows"]:
        """Computes g_j, the integrals of the products of (s − t_{n−i}) / (t − t_{n−i}) over i < j, from 0 to ``end``,
        over h.

        ``end`` is a fraction of the step, by default all of it. With P_j the product and X the end, the integrals of
        P_j(s) (1 − s/X)ᵐ from 0 to X follow from those of P_{j−1}, because s − t_{n−i} is linear in 1 − s/X (Shampine &
        Gordon 1975, chapter 5).
        """
        shares = self._shares()
        moments = jnp.asarray(1 / np.arange(1, self.past.size + 1), self.h.dtype)
        values = [moments[0]]
        for share in shares:
            whole, part = (1.0, share) if end is None else (1 - (1 - end) * share, end * share)
            moments = whole * moments[:-1] - part * moments[1:]
            values.append(moments[0])
        g = jnp.stack(values)
        return g if end is None else end * g

    def _shares(self) -> Float[Array, " count"]:
        """Computes h/(t − t_{n−i})."""
        return self.h / (self.h + self.past[:-1])

    def advance(self) -> Float[Array, " rows"]:
        """Computes ``past`` of the next step."""
        return jnp.concatenate([jnp.zeros_like(self.past[:1]), self.h + self.past[:-1]])


def sums(rows: Float[Array, "*n rows"]) -> Float[Array, "*n rows"]:
    """Computes the sums of all rows before each."""
    items = [rows[..., j] for j in range(rows.shape[-1] - 1)]
    return jnp.stack(_before_each(jnp.add, items, jnp.zeros_like(rows[..., 0])), -1)


def products(factors: Float[Array, "count *n"]) -> Float[Array, "rows *n"]:
    """Computes the products 1, a, ab, abc, … of all factors before each place, and of all of them."""
    return jnp.stack(_before_each(jnp.multiply, list(factors), jnp.ones_like(factors[0])))


def _before_each(combined: Callable[[Array, Array], Array], items: Sequence[Array], first: Array) -> list[Array]:
    """Combines the items one after another: a loop or a library call would cost more."""
    return [first, *itertools.accumulate(items, combined)]


def fold(rows: Float[Array, "rows n"]) -> Float[Array, "lanes columns rows"]:
    """Folds rows of n components to a first axis of eight, along which the native compiler computes in vectors.

    They end with zeros where n is no multiple of eight. One or two components stay as they are.
    """
    n = rows.shape[-1]
    lanes = n if n <= FEW_COMPONENTS else COMPONENTS_OF_VECTOR
    columns = -(-n // lanes) if n else 0
    padded = jnp.pad(rows, ((0, 0), (0, lanes * columns - n)))
    return jnp.transpose(padded.reshape(len(rows), columns, lanes), (2, 1, 0))


def unfold(folds: Float[Array, "lanes columns rows"], n: int) -> Float[Array, "rows n"]:
    """Restores the rows of n components from what :func:`fold` returned."""
    return jnp.transpose(folds, (2, 1, 0)).reshape(folds.shape[2], folds.shape[0] * folds.shape[1])[:, :n]


def adams_error_constants(rows: int) -> np.ndarray:
    """Computes |γ*_j|: the error of the integral over a step by the formula with j points for equal steps, in units of
    h ∇ʲf.

    They are the coefficients of the Adams–Moulton formulas: Hairer, Nørsett & Wanner I, eqs. (III.1.11) and (III.1.12).
    """
    gamma = np.ones(rows)
    for j in range(1, rows):
        gamma[j] = -sum(gamma[i] / (j + 1 - i) for i in range(j))
    return np.abs(gamma)


def leading(kappa: Kappa) -> np.ndarray:
    """Computes (1 − κ) γ_k for each order k: x_{n+1} − P(t_{n+1}) has this factor in the formula."""
    return (1 - KAPPAS[kappa]) * HARMONIC_SUMS


def ndf_error_constants(kappa: Kappa) -> np.ndarray:
    """Computes the error of a step of each order k, in units of ∇ᵏ⁺¹x_{n+1}."""
    return np.abs(KAPPAS[kappa] * HARMONIC_SUMS + 1 / np.arange(1, HIGHEST_BDF + 2))


def up_to(order: Int[Array, ""], rows: int) -> Array:
    """Returns which of the first ``rows`` differences, as a column, belong to the polynomial of degree ``order``."""
    return (jnp.arange(rows) <= order)[:, None]


def ascending(s: Float[Array, "..."], rows: int) -> Float[Array, "rows ..."]:
    """Computes s (s + 1) ⋯ (s + j − 1)/j! for j = 0, 1, …: the weights of the differences at t_n + s H."""
    j = jnp.arange(1, rows, dtype=s.dtype).reshape(-1, *(1,) * s.ndim)
    return products((s[None] + j - 1) / j)


def resample(
    differences: Float[Array, "rows n"], ratio: Float[Array, ""], shift: Float[Array, ""] | float = 0.0
) -> Float[Array, "rows n"]:
    """Computes the differences of the polynomial at t_n + ``shift`` H for points at the distance ``ratio`` H.

    The polynomial is of the degree of the last row that is not zero. As U and R in Shampine & Reichelt, section 2.
    """
    rows = len(differences)
    points = shift - ratio * jnp.arange(rows, dtype=ratio.dtype)
    R, U = ascending(points, rows), jnp.asarray(_binomials_with_signs(rows), ratio.dtype)
    weights = jnp.sum(R[:, :, None] * U[None], axis=1).astype(differences.dtype)
    return jnp.sum(weights[:, :, None] * differences[:, None, :], axis=0)


def stretch(differences: Float[Array, "rows n"], by: Float[Array, ""]) -> Float[Array, "rows n"]:
    """Does as :func:`resample` at the distance (1 + ``by``) H to first order, with its derivative, and much cheaper."""
    slopes = jnp.asarray(_rates_of_stretching(len(differences)), differences.dtype)
    change = jnp.sum(slopes[:, :, None] * differences[:, None, :], axis=0)
    return differences + by.astype(differences.dtype) * change


def advance(
    differences: Float[Array, "rows n"], change: Float[Array, " n"], order: Int[Array, ""]
) -> Float[Array, "rows n"]:
    """Computes the differences at the end of a step, where the state differs by ``change`` from their prediction.

    They are zero above the order of the step. ``change`` is the difference of the order after that.
    """
    rows = len(differences)
    at_or_behind = np.arange(rows)[None] >= np.arange(rows)[:, None]
    summed = jnp.sum(jnp.where(at_or_behind[:, :, None], differences[None], 0.0), axis=1) + change[None]
    return jnp.where(up_to(order, rows), summed, 0.0)


@functools.cache
def _rates_of_stretching(rows: int) -> np.ndarray:
    """Computes the derivative of the weights in :func:`resample` by the distance, where it is H.

    That of s (s + 1) ⋯ (s + i − 1)/i! at s = −m is, with the factor 0 left out where there is one, of products.
    """
    rates = np.zeros((rows, rows))
    for i in range(rows):
        for m in range(rows):
            factors = np.arange(i) - m
            slope = sum(np.prod(np.delete(factors, left)) for left in range(i)) / math.factorial(i)
            rates[i, m] = -m * slope
    return rates @ _binomials_with_signs(rows)


def _binomials_with_signs(rows: int) -> np.ndarray:
    """Computes (−1)ᵐ (j over m), the weight of the value at point m in the difference j."""
    return np.array([[(-1.0) ** m * math.comb(j, m) for j in range(rows)] for m in range(rows)])
