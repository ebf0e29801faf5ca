"""Derivatives beside the places of arrays of fixed size that are not used, and of what is not known."""

from collections.abc import Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Bool, Float, PyTree

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


def with_unknown_derivatives(tree: Tree, given: PyTree, here: Bool[Array, ""] | bool = False) -> Tree:
    """``tree`` as it is, its derivatives with respect to ``given`` NaN ``here`` and wherever it is NaN itself.

    A mask that puts NaN there has the derivative 0, which looks like a number that does not depend on anything. What
    is left out of a result has no part in it still: in reverse mode a cotangent of 0 stays 0.
    """
    inputs = [leaf for leaf in jax.tree.leaves(given) if eqx.is_inexact_array(leaf)]
    numbers, others = eqx.partition(tree, eqx.is_inexact_array)

    def one(leaf: Array) -> Array:
        return jnp.where(here | jnp.isnan(leaf), leaf + _zero_of_unknown_derivative(leaf, inputs), leaf)

    return eqx.combine(jax.tree.map(one, numbers), others)


@jax.custom_jvp
def _zero_of_unknown_derivative(like: Float[Array, "*shape"], inputs: Sequence[Array]) -> Float[Array, "*shape"]:
    return jnp.zeros_like(like)


@_zero_of_unknown_derivative.defjvp
def _(primals, tangents):
    like, _ = primals
    total = sum((jnp.sum(tangent).astype(like.dtype) for tangent in tangents[1]), jnp.zeros((), like.dtype))
    return jnp.zeros_like(like), _unknown.bind(jnp.broadcast_to(total, like.shape))


def _as_unknown(x: Array) -> Array:
    return jnp.full_like(x, jnp.nan)


# Linear to JAX: NaN of a tangent, and of each cotangent but 0.
_unknown = Primitive("unknown_tangent")
_unknown.def_impl(_as_unknown)
_unknown.def_abstract_eval(lambda x: x)
batching.defvectorized(_unknown)
mlir.register_lowering(_unknown, mlir.lower_fun(_as_unknown, multiple_results=False))
ad.deflinear2(_unknown, lambda cotangent, _: [jnp.where(cotangent == 0, cotangent, jnp.nan)])
