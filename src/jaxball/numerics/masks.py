"""Derivatives around unused entries of arrays of fixed size, and of unknown values."""

from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, PyTree

from ..compat import declare_linear, differentiate_by, primitive

Tree = TypeVar("Tree", bound=PyTree)


def differentiated_where(used: Bool[Array, ""], tree: Tree) -> Tree:
    """``tree`` unchanged, with derivatives only where it is ``used``.

    Values computed from an unused entry may have infinite derivatives. A mask on the result sends a zero back to them,
    and 0 · ∞ is NaN; this stops it.
    """

    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    masked = jax.tree.map(lambda leaf: jnp.where(used, leaf, jax.lax.stop_gradient(leaf)), numbers)
    return eqx.combine(masked, others)


def known_or_nothing(known: Bool[Array, "*rows"], leaf: Array) -> Array:
    """``leaf`` where it is known; elsewhere NaN, or −1 where it consists of integers."""
    nothing = jnp.nan if jnp.issubdtype(leaf.dtype, jnp.inexact) else -1
    return jnp.where(known, leaf, jnp.asarray(nothing, leaf.dtype))


def without_derivatives(tree: Tree) -> Tree:
    """``tree`` unchanged, as a constant."""
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    return eqx.combine(jax.lax.stop_gradient(numbers), others)


def with_unknown_derivatives(tree: Tree, given: PyTree, here: Bool[Array, ""] | bool = False) -> Tree:
    """``tree`` unchanged, with NaN derivatives with respect to ``given`` ``here`` and wherever it is NaN itself.

    A mask that puts NaN there has the derivative 0, as if the result depended on nothing. Unused parts of a result
    still have no effect: in reverse mode a cotangent of 0 stays 0.
    """
    inputs = [jnp.sum(leaf) for leaf in jax.tree.leaves(given) if eqx.is_inexact_array(leaf)]
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)
    together: dict[Any, Array] = {}  # of each type

    def one(leaf: Array) -> Array:
        if leaf.dtype not in together:
            together[leaf.dtype] = sum((x.astype(leaf.dtype) for x in inputs), jnp.zeros((), leaf.dtype))
        unknown = _zero.bind(jnp.broadcast_to(together[leaf.dtype], leaf.shape))
        # Less 0 a number is itself, also where it is −0, so that a compiler can leave all of this out.
        return jnp.where(here | jnp.isnan(leaf), leaf - unknown, leaf)

    return eqx.combine(jax.tree.map(one, numbers), others)


# 0, whose tangents are NaN, as is each returning cotangent except one of 0.
_zero = primitive("zero_of_unknown_derivative", jnp.zeros_like)
_nan = primitive("unknown_derivative", lambda x: jnp.full_like(x, jnp.nan))
declare_linear(_nan, lambda cotangent, _: [jnp.where(cotangent == 0, cotangent, jnp.nan)])
differentiate_by(_zero, lambda primals, tangents: (_zero.bind(*primals), _nan.bind(*tangents)))
