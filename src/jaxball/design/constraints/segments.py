"""The distance of two segments of straight lines."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.norms import norm

TINY = 1e-30


def distance(
    a: Float[Array, "3"], to_a: Float[Array, "3"], b: Float[Array, "3"], to_b: Float[Array, "3"]
) -> Float[Array, ""]:
    """The least distance between points of the segments from ``a`` to ``to_a`` and from ``b`` to ``to_b``.

    Either the lines are nearest within both segments, or one end is nearest.
    """
    u, v, w = to_a - a, to_b - b, a - b
    uu, uv, vv, uw, vw = (jnp.sum(x * y) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    determinant = uu * vv - uv**2
    crossing = determinant > TINY
    safe = jnp.where(crossing, determinant, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    within = crossing & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    ends = [
        _of_end(a, b, v, vv),
        _of_end(to_a, b, v, vv),
        _of_end(b, a, u, uu),
        _of_end(to_b, a, u, uu),
    ]
    nearest = jnp.min(jnp.stack(ends))
    return jnp.where(within, norm(w + s * u - t * v), nearest)


def _of_end(end, start, along, size) -> Float[Array, ""]:
    share = jnp.clip(jnp.sum((end - start) * along) / jnp.where(size > 0, size, 1.0), 0.0, 1.0)
    return norm(end - start - share * along)
