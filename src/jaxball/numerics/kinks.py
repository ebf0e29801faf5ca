"""Kinks of functions of time: floating-point times just before and just after them."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

CLOSE = 100  # roundings within which a kink and the end of a run are the same time


def before_kink(kinks: Float[Array, " kinks"], t0: Float[Array, ""], t1: Float[Array, ""]) -> Float[Array, ""]:
    """``t1``, or the last time before the next kink after ``t0`` if that is earlier."""
    ends = before(kinks)
    return jnp.minimum(jnp.min(jnp.where(ends > t0, ends, jnp.inf), initial=jnp.inf), t1)


def seen_from_before(kinks: Float[Array, " kinks"], end: Float[Array, ""]) -> Float[Array, ""]:
    """The time at which to evaluate the end of a run: just before a kink there, otherwise ``end`` itself.

    A quantity that jumps there has, at the kink, the value of the later side, which is not part of the run.
    """
    kinks, near = kinks.astype(end.dtype), CLOSE * jnp.finfo(end.dtype).eps * jnp.abs(end)
    here = (kinks <= end) & (end - kinks <= near)
    earlier = jnp.min(jnp.where(here, before(kinks), jnp.inf), initial=jnp.inf)
    return end + jax.lax.stop_gradient(jnp.minimum(earlier, end) - end)


def before(t: Float[Array, "..."]) -> Float[Array, "..."]:
    """The floating-point number before ``t``, with the derivative of ``t``."""
    return _neighbour(t, -1.0)


def after(t: Float[Array, "..."]) -> Float[Array, "..."]:
    """The floating-point number after ``t``, with the derivative of ``t``."""
    return _neighbour(t, 1.0)


def _neighbour(t: Float[Array, "..."], direction: float) -> Float[Array, "..."]:
    """XLA treats the neighbours of 0 as 0, so the smallest numbers that it distinguishes from 0 are used instead."""
    fixed = jax.lax.stop_gradient(t)
    distance = jnp.abs(jnp.nextafter(fixed, jnp.full_like(fixed, direction * jnp.inf)) - fixed)
    return t + direction * jnp.maximum(distance, jnp.finfo(fixed.dtype).tiny)
