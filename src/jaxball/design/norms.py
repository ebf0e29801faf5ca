"""Lengths of vectors, with derivatives everywhere."""

import jax.numpy as jnp
from jaxtyping import Array, Float

# A square below this is rounding; a derivative there would have the direction of rounding errors.
ROUNDING = 1e-30


def norm(x: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
    """|x| over the last axis, for |x| of order one; 0, with the derivative 0, where it is rounding."""
    squared = jnp.sum(x**2, axis=-1)
    positive = squared > ROUNDING
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0)


def room(x: Float[Array, "*batch n"], most: Float[Array, "*#batch"]) -> Float[Array, "*batch"]:
    """most − |x|, as far as it is small, with all derivatives everywhere: (most² − |x|²) / (2 most)."""
    return (most**2 - jnp.sum(x**2, axis=-1)) / (2 * most)
