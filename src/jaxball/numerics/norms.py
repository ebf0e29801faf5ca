"""Lengths of vectors: with derivatives where they vanish, and of numbers whose squares overflow."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# A square below this is rounding; a derivative there would have the direction of rounding errors.
ROUNDING = 1e-30


def root(square: Float[Array, "*batch"], rounding: float = 0.0) -> Float[Array, "*batch"]:
    """The square root; 0, with the derivative 0, where ``square`` is not above ``rounding``."""
    positive = square > rounding
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def norm(x: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
    """|x| over the last axis, for |x| of order one; 0, with the derivative 0, where it is rounding."""
    return root(jnp.sum(x**2, axis=-1), ROUNDING)


def room(x: Float[Array, "*batch n"], most: Float[Array, "*#batch"]) -> Float[Array, "*batch"]:
    """most − |x|, as far as it is small, with all derivatives everywhere: (most² − |x|²) / (2 most)."""
    return (most**2 - jnp.sum(x**2, axis=-1)) / (2 * most)


def length(x: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch"]:
    """|x| over the last axis, of numbers whose squares overflow or vanish as well; infinite where |x| is too large.

    Numbers are scaled by a power of two, so results for ordinary numbers are the same as from ``numpy.linalg.norm``,
    bit for bit.
    """
    largest = np.max(np.abs(x), axis=-1)
    exponent = np.where(np.isfinite(largest), np.frexp(largest)[1], 0)
    with np.errstate(over="ignore"):
        return np.asarray(np.ldexp(np.linalg.norm(np.ldexp(x, -exponent[..., None]), axis=-1), exponent))
