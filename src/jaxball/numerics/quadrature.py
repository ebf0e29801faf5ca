"""Integrates a function over time by its values at given times, such as those at which a run is saved.

Between two neighbouring times it is the polynomial through the six around them, so that the error decreases with the
sixth power of their distance; the trapezoidal rule has the second one. Values beyond a kink have no part: where the
function jumps, each side goes on as its own values do.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

MOST_NEIGHBOURS = 6


def integrate_samples(
    times: Float[Array, " t"], values: Float[Array, " t"], kinks: Float[Array, " kinks"]
) -> Float[Array, ""]:
    """Computes the integral of a function from the first to the last of its increasing ``times``.

    - ``kinks``: unsorted times at which the function jumps or is not smooth, from which on a value is that of what
      follows. The integral changes with them where the function jumps.
    """
    n = times.size
    neighbours = min(MOST_NEIGHBOURS, n)
    interval = np.arange(n - 1)
    first = np.clip(interval - (neighbours - 2) // 2, 0, n - neighbours)
    window = first[:, None] + np.arange(neighbours)
    stretch = jnp.sum(kinks[None] <= times[:, None], axis=1)  # the number of the smooth one in which each time lies
    inside = (kinks[None] > times[:-1, None]) & (kinks[None] <= times[1:, None])
    earliest = jnp.min(jnp.where(inside, kinks[None], jnp.inf), axis=1, initial=jnp.inf)
    latest = jnp.max(jnp.where(inside, kinks[None], -jnp.inf), axis=1, initial=-jnp.inf)
    # What happens between several kinks in one interval no value tells.
    has_kink = stretch[1:] > stretch[:-1]
    middle = jnp.where(
        has_kink, 0.5 * (jnp.where(has_kink, earliest, 0.0) + jnp.where(has_kink, latest, 0.0)), times[1:]
    )
    before = _integrate_parts(times, values, (times[:-1], middle), window, stretch[window] == stretch[:-1, None])
    after = _integrate_parts(times, values, (middle, times[1:]), window, stretch[window] == stretch[1:, None])
    return jnp.sum(before + after)


def _integrate_parts(
    times: Float[Array, " t"],
    values: Float[Array, " t"],
    ends: tuple[Float[Array, " parts"], Float[Array, " parts"]],
    window: np.ndarray,
    counts: Array,
) -> Float[Array, " parts"]:
    """Integrates over each part, between its two ends, the polynomial through those values of its window that count."""
    nodes, weights = legendre.leggauss(MOST_NEIGHBOURS // 2)
    low, high = ends
    half = 0.5 * (high - low)
    x = 0.5 * (low + high)[:, None] + jnp.asarray(nodes, times.dtype)[None] * half[:, None]
    points, neighbours = times[window], window.shape[1]
    # Lagrange's polynomials: the product of the factors of all other points that count.
    others = counts[:, None, :] & ~np.eye(neighbours, dtype=bool)[None]
    distance = jnp.where(others, points[:, :, None] - points[:, None, :], 1.0)
    factors = jnp.where(others[:, None], (x[:, :, None] - points[:, None])[:, :, None, :], 1.0) / distance[:, None]
    shares = jnp.sum(jnp.asarray(weights, times.dtype)[None, :, None] * jnp.prod(factors, axis=-1), axis=1)
    return half * jnp.sum(jnp.where(counts, shares * values[window], 0.0), axis=1)
