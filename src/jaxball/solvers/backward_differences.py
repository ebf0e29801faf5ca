"""Backward differences of states at equal distances, and the differentiation formulas made of them, for ``ndf``.

∇⁰x_n = x_n and ∇ʲ⁺¹x_n = ∇ʲx_n − ∇ʲx_{n−1}. The polynomial of degree k through x_n, x_{n−1}, …, x_{n−k} is

    P(t_n + s H) = Σⱼ ∇ʲx_n s (s + 1) ⋯ (s + j − 1)/j!,    j = 0 … k,

with H the distance of the points. The formulas of Klopfenstein and Shampine set its derivative at the end of a step,
corrected by a multiple of the prediction error, equal to the slope there:

    Σⱼ ∇ʲx_{n+1}/j − κ γ_k (x_{n+1} − P(t_{n+1})) = h f(t_{n+1}, x_{n+1}),    j = 1 … k,

with γ_k = 1 + ½ + … + 1/k. With κ = 0 they are those of Curtiss and Hirschfelder (BDF).

Shampine & Reichelt, *The MATLAB ODE Suite*, SIAM J. Sci. Comput. 18 (1997) 1–22, section 2, with the values of κ in
table 1; Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I* (1993), section III.5, eqs. (5.10) on.
"""

import functools
import math
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .differences import products

HIGHEST_BDF = 5
Kappa = Literal["ndf", "bdf"]
# From order 0. That of order 5 is zero, because the stability region would become too small.
KAPPAS: dict[str, np.ndarray] = {
    "ndf": np.array([0.0, -0.1850, -1 / 9, -0.0823, -0.0415, 0.0]),
    "bdf": np.zeros(HIGHEST_BDF + 1),
}
HARMONIC_SUMS = np.concatenate([[0.0], np.cumsum(1 / np.arange(1, HIGHEST_BDF + 1))])


def leading(kappa: Kappa) -> np.ndarray:
    """Computes (1 − κ) γ_k for each order k: x_{n+1} − P(t_{n+1}) has this factor in the formula."""
    return (1 - KAPPAS[kappa]) * HARMONIC_SUMS


def error_constants(kappa: Kappa) -> np.ndarray:
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
