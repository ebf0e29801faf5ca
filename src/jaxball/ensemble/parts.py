"""Functions of many rows, computed a few rows at a time, so that what lies between stays in a processor's cache."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


def in_parts(function: Callable[[Any], Any], rows: Any, size: int) -> Any:
    """``function`` of PyTrees of arrays whose last axis is that of the rows, ``size`` rows at a time."""
    count = jax.tree.leaves(rows)[0].shape[-1]
    parts = -(-count // size)

    def split(leaf: jax.Array) -> jax.Array:
        whole = jnp.pad(leaf, [(0, 0)] * (leaf.ndim - 1) + [(0, parts * size - count)], mode="edge")
        return jnp.moveaxis(whole.reshape(*leaf.shape[:-1], parts, size), -2, 0)

    def joined(leaf: jax.Array) -> jax.Array:
        return jnp.moveaxis(leaf, 0, -2).reshape(*leaf.shape[1:-1], parts * size)[..., :count]

    return jax.tree.map(joined, jax.lax.map(function, jax.tree.map(split, rows)))
