"""Derivatives along a curve, by forward mode."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Curve = Callable[[Float[Array, ""]], Float[Array, "..."]]


def two_derivatives(
    curve: Curve, x: Float[Array, ""]
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """The value of ``curve`` at ``x`` with its first and second derivatives."""
    x = jnp.asarray(x)
    one = jnp.ones_like(x)

    def value_and_slope(x):
        return jax.jvp(curve, (x,), (one,))

    (value, slope), (_, curvature) = jax.jvp(value_and_slope, (x,), (one,))
    return value, slope, curvature
