"""Lengths of vectors, with derivatives everywhere."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def norm(x: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
    """|x| over the last axis; its derivative is 0 where it is 0."""
    squared = jnp.sum(x**2, axis=-1)
    positive = squared > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0)
