"""Piecewise polynomials, and cubic splines as such."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class PiecewisePolynomial(eqx.Module):
    """Polynomials joined at ``breaks``; the first and the last extend to infinity.

    Piece j is Σ_k coefficients[j, k] (x − origins[j])ᵏ and holds for breaks[j−1] ≤ x < breaks[j].
    """

    breaks: Float[Array, "*group breaks"]
    origins: Float[Array, "*group pieces"]
    coefficients: Float[Array, "..."]

    def __call__(self, x: Float[Array, ""]) -> Float[Array, "*shape"]:
        infinity = jnp.array([jnp.inf], dtype=self.breaks.dtype)
        holds = (jnp.concatenate([-infinity, self.breaks]) <= x) & (x < jnp.concatenate([self.breaks, infinity]))
        s = x - jnp.sum(jnp.where(holds, self.origins, 0.0))
        mask = holds.reshape(holds.shape + (1,) * (self.coefficients.ndim - 1))
        c = jnp.sum(jnp.where(mask, self.coefficients, 0.0), axis=0)
        value = c[-1]
        for k in range(c.shape[0] - 2, -1, -1):
            value = value * s + c[k]
        return value


def periodic_cubic_spline(
    knots: Float[Array, " n_plus_one"], values: Float[Array, "n *shape"]
) -> Float[Array, "n 4 *shape"]:
    """Coefficients of the twice continuously differentiable periodic cubic through ``values``.

    ``knots`` has one entry more than ``values``: its last is where the first value comes again.
    """
    n = values.shape[0]
    h = jnp.diff(knots)
    step = h.reshape(h.shape + (1,) * (values.ndim - 1))
    chord = (jnp.roll(values, -1, axis=0) - values) / step
    before = jnp.roll(h, 1)
    rows = jnp.arange(n)
    matrix = jnp.zeros((n, n), dtype=values.dtype)
    matrix = matrix.at[rows, rows].add(2 * (before + h))
    matrix = matrix.at[rows, (rows - 1) % n].add(before)
    matrix = matrix.at[rows, (rows + 1) % n].add(h)
    right = 6 * (chord - jnp.roll(chord, 1, axis=0))
    bend = jnp.linalg.solve(matrix, right.reshape(n, -1)).reshape(values.shape)
    return _hermite_pieces(values, chord, bend, jnp.roll(bend, -1, axis=0), step)


def clamped_cubic_spline(
    knots: Float[Array, " n"],
    values: Float[Array, "n *shape"],
    end_slopes: Float[Array, "2 *shape"],
) -> Float[Array, "n_minus_one 4 *shape"]:
    """Coefficients of the twice continuously differentiable cubic through ``values`` with given end slopes."""
    n = values.shape[0]
    h = jnp.diff(knots)
    step = h.reshape(h.shape + (1,) * (values.ndim - 1))
    chord = jnp.diff(values, axis=0) / step
    rows = jnp.arange(n)
    zero = jnp.zeros((1,), dtype=h.dtype)
    before, after = jnp.concatenate([zero, h]), jnp.concatenate([h, zero])
    matrix = jnp.zeros((n, n), dtype=values.dtype)
    matrix = matrix.at[rows, rows].add(2 * (before + after))
    matrix = matrix.at[rows[1:], rows[:-1]].add(h)
    matrix = matrix.at[rows[:-1], rows[1:]].add(h)
    slopes = jnp.concatenate([end_slopes[:1], chord, end_slopes[1:]])
    right = 6 * jnp.diff(slopes, axis=0)
    bend = jnp.linalg.solve(matrix, right.reshape(n, -1)).reshape(values.shape)
    return _hermite_pieces(values[:-1], chord, bend[:-1], bend[1:], step)


def _hermite_pieces(values, chord, bend, next_bend, step):
    slope = chord - step * (2 * bend + next_bend) / 6
    return jnp.stack([values, slope, bend / 2, (next_bend - bend) / (6 * step)], axis=1)
