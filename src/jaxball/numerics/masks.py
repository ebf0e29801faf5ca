"""Derivatives beside the places of arrays of fixed size that are not used."""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PyTree

Tree = TypeVar("Tree", bound=PyTree)


def differentiated_where(used: Bool[Array, ""], tree: Tree) -> Tree:
    """``tree`` as it is, with derivatives where it is ``used`` alone.

    Where a place is not used, what is computed from it may have infinite derivatives. A mask on the result sends a
    zero back to them, and 0 · ∞ is not a number; here that ends.
    """

    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    masked = jax.tree.map(lambda leaf: jnp.where(used, leaf, jax.lax.stop_gradient(leaf)), numbers)
    return eqx.combine(masked, others)


def without_derivatives(tree: Tree) -> Tree:
    """``tree`` as it is, as a constant."""
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.lax.stop_gradient(numbers), others)
