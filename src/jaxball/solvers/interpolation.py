"""The polynomials of the methods as dense output."""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from .backward_differences import ascending
from .differences import Points


class CollocationPolynomial(diffrax.AbstractLocalInterpolation):
    """u(t0 + θh) = y₀ + Σₖ coefficientₖ ∫₀^θ P̃ₖ."""

    t0: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    t1: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    y0: PyTree[Array]
    coefficients: PyTree[Array]

    def evaluate(self, t0: Any, t1: Any = None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        count = len(jax.tree.leaves(self.coefficients)[0])
        weights = jnp.stack(integrals(_fraction(self, t0), count))
        return jax.tree.map(
            lambda y, a: y + jnp.tensordot(weights.astype(y.dtype), a, axes=1), self.y0, self.coefficients
        )


class CubicHermite(diffrax.AbstractLocalInterpolation):
    """The cubic with values y₀, y₁ and slopes k₀, k₁ at the ends, in units of 1/h."""

    t0: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    t1: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    y0: PyTree[Array]
    y1: PyTree[Array]
    k0: PyTree[Array]
    k1: PyTree[Array]

    def evaluate(self, t0: Any, t1: Any = None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        theta = _fraction(self, t0)

        def cubic(y0, y1, k0, k1):
            u = theta.astype(y0.dtype)
            lacking = (1 - 2 * u) * (y1 - y0) + (u - 1) * k0 + u * k1
            return (1 - u) * y0 + u * y1 + u * (u - 1) * lacking

        return jax.tree.map(cubic, self.y0, self.y1, self.k0, self.k1)


class AdamsPolynomial(diffrax.AbstractLocalInterpolation):
    """u(t0 + θh) = y₀ + Σⱼ gⱼ(θ) termⱼ, the integral of the polynomial through the slopes at points ``past``."""

    t0: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    t1: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    y0: PyTree[Array]
    terms: PyTree[Array]
    past: Float[Array, " rows"]

    def evaluate(self, t0: Any, t1: Any = None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        width = self.t1 - self.t0
        weights = Points(self.past, jnp.where(width == 0, 1.0, width)).integrals(_fraction(self, t0))
        return jax.tree.map(lambda y, terms: y + _weighted(weights, terms), self.y0, self.terms)


class BackwardPolynomial(diffrax.AbstractLocalInterpolation):
    """u(t0 + θh) = y₁ + Σⱼ (θ − 1) θ ⋯ (θ + j − 2)/j! termⱼ, the polynomial with the backward differences ``terms``.

    It is evaluated from y₀ = y₁ − term₁, to reduce rounding.
    """

    t0: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    t1: Float[Array, ""]  # pyright: ignore[reportIncompatibleVariableOverride]
    y0: PyTree[Array]
    terms: PyTree[Array]

    def evaluate(self, t0: Any, t1: Any = None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        fraction = _fraction(self, t0)
        count = len(jax.tree.leaves(self.terms)[0])
        weights = ascending(fraction - 1, count + 1)[1:].at[0].set(fraction)
        return jax.tree.map(lambda y, terms: y + _weighted(weights, terms), self.y0, self.terms)


def _weighted(weights: Float[Array, " rows"], terms: Float[Array, "rows *shape"]) -> Float[Array, "*shape"]:
    return jnp.sum(weights.astype(terms.dtype).reshape(-1, *(1,) * (terms.ndim - 1)) * terms, axis=0)


def _fraction(step, t: Float[Array, ""]) -> Float[Array, ""]:
    """Where in the step ``t`` is, from 0 to 1."""
    width = step.t1 - step.t0
    return (t - step.t0) / jnp.where(width == 0, 1.0, width)


def integrals(x: Float[Array, ""], count: int) -> list[Float[Array, ""]]:
    """∫₀ˣ P̃ₖ for k = 0 … count − 1."""
    P = legendre(x, count + 1)
    return [x] + [(P[k + 1] - P[k - 1]) / (2 * (2 * k + 1)) for k in range(1, count)]


def legendre(x: Float[Array, "..."], count: int) -> list[Float[Array, "..."]]:
    """P̃ₖ(x) for k = 0 … count − 1, on [0, 1] and beyond."""
    u = 2 * x - 1
    P = [jnp.ones_like(u), u]
    for k in range(1, count - 1):
        P.append(((2 * k + 1) * u * P[k] - k * P[k - 1]) / (k + 1))
    return P[:count]
