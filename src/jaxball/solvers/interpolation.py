"""The collocation polynomial as dense output."""

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree


class CollocationPolynomial(diffrax.AbstractLocalInterpolation):
    """u(t0 + θh) = y₀ + Σₖ coefficientₖ ∫₀^θ P̃ₖ."""

    t0: Float[Array, ""]
    t1: Float[Array, ""]
    y0: PyTree[Array]
    coefficients: PyTree[Array]

    def evaluate(self, t0, t1=None, left=True):
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        count = len(jax.tree.leaves(self.coefficients)[0])
        width = self.t1 - self.t0
        theta = (t0 - self.t0) / jnp.where(width == 0, 1.0, width)
        weights = jnp.stack(integrals(theta, count))
        return jax.tree.map(
            lambda y, a: y + jnp.tensordot(weights.astype(y.dtype), a, axes=1), self.y0, self.coefficients
        )


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
