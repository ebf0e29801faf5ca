"""Integrates a function over time by its values at given times, such as those at which a run is saved.

Between two neighbouring times it is the polynomial through the six around them, so that the error decreases with the
sixth power of their distance; the trapezoidal rule has the second one. Values beyond a kink have no part: where the
function jumps, each side goes on as its own values do.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.polynomial import legendre

MOST_NEIGHBOURS = 6


def integrate_samples(
    times: Float[Array, " t"], values: Float[Array, "t k"], kinks: Float[Array, " kinks"]
) -> Float[Array, " k"]:
    """Computes the integrals of k functions from the first to the last of their increasing ``times``.

    - ``kinks``: unsorted times at which a function jumps or is not smooth; at such a time, its value is the one after
      it. The integral changes with them where the function jumps.
    """
    n = times.size
    neighbours = min(MOST_NEIGHBOURS, n)
    interval = np.arange(n - 1)
    window = np.clip(interval - (neighbours - 2) // 2, 0, n - neighbours)[:, None] + np.arange(neighbours)[None]
    stretch = jnp.sum(kinks[None] <= times[:, None], axis=1)  # the number of the smooth one in which each time lies
    inside = (kinks[None] > times[:-1, None]) & (kinks[None] <= times[1:, None])
    earliest = jnp.min(jnp.where(inside, kinks[None], jnp.inf), axis=1, initial=jnp.inf)
    latest = jnp.max(jnp.where(inside, kinks[None], -jnp.inf), axis=1, initial=-jnp.inf)
    has_kink = stretch[1:] > stretch[:-1]
    # What happens between several kinks in one interval no value tells.
    between = 0.5 * (jnp.where(has_kink, earliest, 0.0) + jnp.where(has_kink, latest, 0.0))
    middle = jnp.where(has_kink, between, times[1:])
    counts = stretch[window] == stretch[:-1, None]
    total = _integrate_parts(times[window], values[window], (times[:-1], middle), counts)
    if not kinks.size:
        return total
    # Behind kinks, of which there are few, each interval counts once.
    row = jnp.clip(jnp.sum(times[None] < kinks[:, None], axis=1) - 1, 0, n - 2)
    again = jnp.any((row[:, None] == row[None]) & np.tri(kinks.size, k=-1, dtype=bool), axis=1)
    behind, counts = jnp.asarray(window)[row], has_kink[row] & ~again
    same = (stretch[behind] == stretch[row + 1][:, None]) & counts[:, None]
    return total + _integrate_parts(times[behind], values[behind], (middle[row], times[row + 1]), same)


def _integrate_parts(
    points: Float[Array, "parts n"],
    values: Float[Array, "parts n k"],
    ends: tuple[Float[Array, " parts"], Float[Array, " parts"]],
    counts: Bool[Array, "parts n"],
) -> Float[Array, " k"]:
    """Integrates over parts, each between its two ends, the polynomial through those values at points that count."""
    nodes, weights = legendre.leggauss(MOST_NEIGHBOURS // 2)
    low, high = ends
    half = 0.5 * (high - low)
    x = 0.5 * (low + high)[:, None] + jnp.asarray(nodes, points.dtype)[None] * half[:, None]
    # Lagrange's polynomials: the product of the factors of all other points that count.
    others = counts[:, None, :] & ~np.eye(points.shape[1], dtype=bool)[None]
    scale = 1 / jnp.where(others, points[:, :, None] - points[:, None, :], 1.0)
    factors = jnp.where(others[:, None], (x[:, :, None] - points[:, None])[:, :, None, :], 1.0)
    products = jnp.sum(jnp.asarray(weights, points.dtype)[None, :, None] * jnp.prod(factors, axis=-1), axis=1)
    shares = jnp.where(counts, half[:, None] * products * jnp.prod(scale, axis=-1), 0.0)
    return jnp.sum(jnp.where(counts[..., None], shares[..., None] * values, 0.0), axis=(0, 1))
