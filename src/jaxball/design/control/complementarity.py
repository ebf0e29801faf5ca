"""Complementary pairs: slack > 0, multiplier > 0, and slack · multiplier = µ, as functions of one free number.

These are the conditions of an interior point with the barrier µ. With s = slack − multiplier they hold whatever s is
(Chen & Harker 1993, Kanzow 1996), so that Newton's method need not keep anything positive, and may start where an
inequality is violated.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float


def slack(s: Float[Array, " k"], barrier: Float[Array, ""]) -> Float[Array, " k"]:
    """(√(s² + 4 µ) + s) / 2."""
    return (jnp.sqrt(s**2 + 4 * barrier) + s) / 2


def multiplier(s: Float[Array, " k"], barrier: Float[Array, ""]) -> Float[Array, " k"]:
    """(√(s² + 4 µ) − s) / 2."""
    return slack(-s, barrier)
