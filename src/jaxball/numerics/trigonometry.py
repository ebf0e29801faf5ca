"""Sine and cosine together, as arithmetic that a compiler can vectorise and fuse.

XLA's CPU backend computes float64 sines and cosines one number and one library call at a time, which
takes most of the time of a ball's equation of motion. Here the angle is reduced to [−π/4, π/4] by
Cody and Waite's method (*Software Manual for the Elementary Functions*, 1980) and the Taylor series
are cut where the next term is below half a unit of float64's last place.
"""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..compat import differentiate_by, primitive

# π/2 in three parts; the first two have 33 bits, so that multiples of them up to 2²⁰ are exact.
HALF_PI = (
    float.fromhex("0x1.921fb544p+0"),
    float.fromhex("0x1.0b4611a6p-34"),
    float.fromhex("0x1.3198a2e037073p-69"),
)
SINE = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(8))
COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(9))


def sine_cosine(x: Float[Array, "*shape"]) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """sin x and cos x of an angle in radians, to 2e-16 for |x| up to 10⁶ and beyond that to the rounding of x itself.

    For types other than float64, those of ``jax.numpy``. Derivatives of any order are sines and cosines again.
    """
    sine, cosine = sine_cosine_p.bind(jnp.asarray(x))
    return sine, cosine


def written_out(x: Float[Array, "*shape"]) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """What :func:`sine_cosine` computes, by operations of JAX."""
    if x.dtype != jnp.float64:
        return jnp.sin(x), jnp.cos(x)
    quarter = jnp.round(x * (2 / math.pi))
    for part in HALF_PI:
        x = x - quarter * part
    square = x * x
    s, c = x * _polynomial(SINE, square), _polynomial(COSINE, square)
    turn = quarter - 4 * jnp.floor(quarter / 4)
    odd = (turn == 1) | (turn == 3)
    sine, cosine = jnp.where(odd, c, s), jnp.where(odd, s, c)
    return jnp.where(turn >= 2, -sine, sine), jnp.where((turn == 1) | (turn == 2), -cosine, cosine)


def _polynomial(coefficients: tuple[float, ...], x: Array) -> Array:
    value = jnp.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        value = value * x + coefficient
    return value


def _jvp(primals, tangents):
    (dx,), (sine, cosine) = tangents, sine_cosine_p.bind(*primals)
    return (sine, cosine), (cosine * dx, -sine * dx)


# A primitive, so that its derivatives are sines and cosines, not those of the polynomials.
sine_cosine_p = primitive("sine_cosine", written_out, results=2)
differentiate_by(sine_cosine_p, _jvp)
