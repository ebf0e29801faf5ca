"""The Illinois method for the zero of a function of one variable between two points where its signs differ.

The zero of the secant replaces the newer end of the bracket. If the sign did not change, the other end stays and its
value is halved, so that both ends approach the zero (Dowell & Jarratt, *BIT* 11 (1971) 168–174). Arguments are numbers
or arrays, of JAX or, with ``xp=numpy``, of NumPy.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp


class Sample(NamedTuple):
    """A point x and the function's value f there."""

    x: Any
    f: Any


def between(old: Sample, new: Sample, xp: Any = None) -> Any:
    """Returns the next point: the zero of the secant, or the midpoint if that is not inside or an end is already a
    zero.
    """
    xp = xp or jnp
    slope = new.f - old.f
    x = new.x - new.f * (new.x - old.x) / xp.where(slope == 0, 1.0, slope)
    inside = ((x - old.x) * (x - new.x) <= 0) & (old.f != 0) & (new.f != 0)
    return xp.where(inside, x, (old.x + new.x) / 2)


def other_end(old: Sample, new: Sample, newest: Sample, xp: Any = None) -> Sample:
    """Returns the end of the next bracket opposite to ``newest``, which lies between; at a zero, ``newest`` itself."""
    xp = xp or jnp
    crossed, is_zero = (newest.f > 0) != (new.f > 0), newest.f == 0
    x, f = xp.where(crossed, new.x, old.x), xp.where(crossed, new.f, old.f / 2)
    return Sample(xp.where(is_zero, newest.x, x), xp.where(is_zero, newest.f, f))
