"""The dense output of the solvers here: the polynomial of each method within a step."""

import abc
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from .differences import Points, ascending


class _Polynomial(diffrax.AbstractLocalInterpolation):
    """A polynomial over a step from y₀."""

    t0: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    t1: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    y0: PyTree[Array]

    @abc.abstractmethod
    def at(self, theta: Float[Array, ""]) -> PyTree[Array]:
        """Evaluates u(t0 + θh)."""

    def evaluate(self, t0: Any, t1: Any = None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        return self.at((t0 - self.t0) / self._width)

    @property
    def _width(self) -> Float[Array, ""]:
        """h, or 1 for a step without length."""
        width = self.t1 - self.t0
        return jnp.where(width == 0, 1.0, width)


class CollocationPolynomial(_Polynomial):
    """u(t0 + θh) = y₀ + Σₖ coefficientₖ ∫₀^θ P̃ₖ."""

    coefficients: PyTree[Array]

    def at(self, theta):
        weights = jnp.stack(integrals(theta, _rows(self.coefficients)))
        return jax.tree.map(
            lambda y, a: y + jnp.tensordot(weights.astype(y.dtype), a, axes=1), self.y0, self.coefficients
        )


class CubicHermite(_Polynomial):
    """The cubic with values y₀, y₁ and slopes k₀, k₁ at the ends, in units of 1/h."""

    y1: PyTree[Array]
    k0: PyTree[Array]
    k1: PyTree[Array]

    def at(self, theta):
        def cubic(y0, y1, k0, k1):
            u = theta.astype(y0.dtype)
            lacking = (1 - 2 * u) * (y1 - y0) + (u - 1) * k0 + u * k1
            return (1 - u) * y0 + u * y1 + u * (u - 1) * lacking

        return jax.tree.map(cubic, self.y0, self.y1, self.k0, self.k1)


class AdamsPolynomial(_Polynomial):
    """u(t0 + θh) = y₀ + Σⱼ gⱼ(θ) termⱼ, the integral of the polynomial through the slopes at points ``past``."""

    terms: PyTree[Array]
    past: Float[Array, " rows"]

    def at(self, theta):
        weights = Points(self.past, self._width).integrals(theta)
        return jax.tree.map(lambda y, terms: y + _weigh(weights, terms), self.y0, self.terms)


class BackwardPolynomial(_Polynomial):
    """u(t0 + θh) = y₁ + Σⱼ (θ − 1) θ ⋯ (θ + j − 2)/j! termⱼ, the polynomial with the backward differences ``terms``.

    It is evaluated from y₀ = y₁ − term₁, to reduce rounding.
    """

    terms: PyTree[Array]

    def at(self, theta):
        weights = ascending(theta - 1, _rows(self.terms) + 1)[1:].at[0].set(theta)
        return jax.tree.map(lambda y, terms: y + _weigh(weights, terms), self.y0, self.terms)


def _rows(terms: PyTree[Array]) -> int:
    return len(jax.tree.leaves(terms)[0])


def _weigh(weights: Float[Array, " rows"], terms: Float[Array, "rows *shape"]) -> Float[Array, "*shape"]:
    return jnp.sum(weights.astype(terms.dtype).reshape(-1, *(1,) * (terms.ndim - 1)) * terms, axis=0)


def integrals(x: Float[Array, ""], count: int) -> list[Float[Array, ""]]:
    """Computes ∫₀ˣ P̃ₖ for k = 0 … count − 1."""
    P = legendre(x, count + 1)
    return [x] + [(P[k + 1] - P[k - 1]) / (2 * (2 * k + 1)) for k in range(1, count)]


def legendre(x: Float[Array, "..."], count: int) -> list[Float[Array, "..."]]:
    """Computes P̃ₖ(x) for k = 0 … count − 1, on [0, 1] and beyond."""
    u = 2 * x - 1
    P = [jnp.ones_like(u), u]
    for k in range(1, count - 1):
        P.append(((2 * k + 1) * u * P[k] - k * P[k - 1]) / (k + 1))
    return P[:count]
