"""Three-vectors, small matrices and angles, as arithmetic that a compiler can vectorise and fuse.

``jnp.dot`` and ``jnp.linalg.solve`` become library calls, and one such call inside a loop's body keeps XLA's CPU
compiler from fusing that body. Here products and lengths are sums and products of elements only.

XLA's CPU backend computes float64 sines and cosines one number and one library call at a time, which takes most of the
time of a ball's equation of motion. Here the angle is reduced to [−π/4, π/4] by Cody and Waite's method (*Software
Manual for the Elementary Functions*, 1980) and the Taylor series are cut where the next term is below half a unit of
float64's last place.
"""

import math
from collections.abc import Callable, Sequence
from typing import overload

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.compat import differentiate_by, primitive

# π/2 in three parts; the first two have 33 bits, so that multiples of them up to 2²⁰ are exact.
HALF_PI = (
    float.fromhex("0x1.921fb544p+0"),
    float.fromhex("0x1.0b4611a6p-34"),
    float.fromhex("0x1.3198a2e037073p-69"),
)
SINE = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(8))
COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(9))


def dot(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, ""]:
    """Returns the scalar product a · b."""
    return jnp.sum(a * b)


def cross(a: Float[Array, "*rows 3"], b: Float[Array, "*rows 3"]) -> Float[Array, "*rows 3"]:
    """Returns the vector product a × b, of rows where there are more."""
    return _next(a * _next(b) - _next(a) * b)


def _next(a: Float[Array, "*rows 3"]) -> Float[Array, "*rows 3"]:
    """Puts components 1, 2 and 0 in place of 0, 1 and 2."""
    return jax.lax.concatenate([a[..., 1:], a[..., :1]], a.ndim - 1)


def outer(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Returns the dyad a bᵀ."""
    return a[:, None] * b[None, :]


def on_diagonal(x: Float[Array, "*three"]) -> Float[Array, "3 3"]:
    """Returns the matrix with these numbers on its diagonal, and with −0 elsewhere: added to any number, it changes not
    even the sign of a zero, so that nothing is computed.
    """
    return jnp.where(np.eye(3, dtype=bool), x, -0.0)


def symmetric(A: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """Returns a matrix that is symmetric but for rounding, with what is above its diagonal below it as well, so that a
    compiler computes six numbers and not nine.
    """
    return jnp.where(np.triu(np.ones((3, 3), bool)), A, A.T)


def apply(A: Float[Array, "k n"], b: Float[Array, " n"]) -> Float[Array, " k"]:
    """Returns the product A b."""
    return jnp.sum(A * b[None, :], axis=1)


def hat(a: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Returns the antisymmetric matrix â with â b = a × b."""
    zero = jnp.zeros_like(a[0])
    return jnp.stack(
        [
            jnp.stack([zero, -a[2], a[1]]),
            jnp.stack([a[2], zero, -a[0]]),
            jnp.stack([-a[1], a[0], zero]),
        ]
    )


def turn_about(n: Float[Array, "3"], angle: Float[Array, ""]) -> Float[Array, "3 3"]:
    """Computes the matrix of the rotation by an angle, rad, about the unit vector ``n``, by Rodrigues' formula."""
    sine, cosine = sine_cosine(angle)
    return cosine * jnp.eye(3, dtype=n.dtype) + sine * hat(n) + (1 - cosine) * outer(n, n)


def unit_vector(a: Float[Array, "3"]) -> Float[Array, "3"]:
    """Returns the unit vector a / |a|."""
    return a / jnp.sqrt(dot(a, a))


def inverse(A: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """Computes A⁻¹ by cofactors; not finite where A is singular."""
    C = cofactors(A)
    determinant = dot(A[0], C[0])
    # 1/∞ would be 0, with which nothing is ever accelerated.
    determinant = jnp.where(jnp.abs(determinant) < jnp.inf, determinant, jnp.nan)
    return C.T * (1.0 / determinant)  # nine divisions take as long as a hundred products


def cofactors(A: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """Returns the vector products of the rows of A: of the second and third, the third and first, the first
    and second.
    """
    after = jnp.concatenate([A[1:], A[:1]])
    return cross(after, jnp.concatenate([after[1:], after[:1]]))


# A square below this is rounding; a derivative there would have the direction of rounding errors.
ROUNDING_SQUARED = 1e-30


def root(square: Float[Array, "*batch"], rounding: float = 0.0) -> Float[Array, "*batch"]:
    """Returns the square root; 0, with the derivative 0, where ``square`` is not above ``rounding``."""
    positive = square > rounding
    # The slope of the root at 0 is infinite, also in the branch that `where` does not take.
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


def in_three(v: Float[Array, "2"]) -> Float[Array, "3"]:
    """Returns a horizontal vector with its third component, 0."""
    return jnp.concatenate([v, jnp.zeros_like(v[:1])])


def norm(x: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
    """Returns |x| over the last axis, for |x| of order one; 0, with the derivative 0, where it is rounding."""
    return root(jnp.sum(x**2, axis=-1), ROUNDING_SQUARED)


def room(x: Float[Array, "*batch n"], most: Float[Array, "*#batch"]) -> Float[Array, "*batch"]:
    """Computes most − |x|, as far as it is small, with all derivatives everywhere: (most² − |x|²) / (2 most)."""
    return (most**2 - jnp.sum(x**2, axis=-1)) / (2 * most)


def length(x: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch"]:
    """Computes |x| over the last axis, also where the squares of the numbers overflow or vanish; infinite where |x| is
    too large.

    Numbers are scaled by a power of two, so results for ordinary numbers are the same as from ``numpy.linalg.norm``,
    bit for bit.
    """
    largest = np.max(np.abs(x), axis=-1)
    exponent = np.where(np.isfinite(largest), np.frexp(largest)[1], 0)
    with np.errstate(over="ignore"):
        return np.asarray(np.ldexp(np.linalg.norm(np.ldexp(x, -exponent[..., None]), axis=-1), exponent))


def sine_cosine(x: Float[Array, "*shape"]) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """Computes sin x and cos x of an angle in radians, to 2e-16 for |x| up to 10⁶ and beyond that to the rounding of x
    itself.

    For types other than float64, those of ``jax.numpy``. Derivatives of any order are sines and cosines again.
    """
    sine, cosine = sine_cosine_p.bind(jnp.asarray(x))
    return sine, cosine


def sine_cosine_of_jax(x: Float[Array, "*shape"]) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    """Computes the results of :func:`sine_cosine` by operations of JAX."""
    if x.dtype != jnp.float64:
        return jnp.sin(x), jnp.cos(x)
    quarter = jnp.round(x * (2 / math.pi))
    for part in HALF_PI:
        x = x - quarter * part
    square = x * x
    s, c = x * polynomial(SINE, square), polynomial(COSINE, square)
    turn = quarter - 4 * jnp.floor(0.25 * quarter)
    odd = (turn == 1) | (turn == 3)
    sine, cosine = jnp.where(odd, c, s), jnp.where(odd, s, c)
    return jnp.where(turn >= 2, -sine, sine), jnp.where((turn == 1) | (turn == 2), -cosine, cosine)


def polynomial(coefficients: Sequence[float] | np.ndarray, x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Evaluates the polynomial with these coefficients, the lowest first, by Horner's rule."""
    value = jnp.full_like(x, coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        value = value * x + coefficient
    return value


def _jvp(primals, tangents):
    (dx,), (sine, cosine) = tangents, sine_cosine_p.bind(*primals)
    return (sine, cosine), (cosine * dx, -sine * dx)


# A primitive, so that its derivatives are sines and cosines, not those of the polynomials.
sine_cosine_p = primitive("sine_cosine", sine_cosine_of_jax, results=2)
differentiate_by(sine_cosine_p, _jvp)


# Terms that may be absent: None stands for one that is 0 and is not computed. A sum over what acts on a body is then
# written once, whatever acts, and a program contains nothing but the terms there are.


@overload
def add(first: Array, /, *others: Array | None) -> Array: ...
@overload
def add(*terms: Array | None) -> Array | None: ...
def add(*terms: Array | None) -> Array | None:
    """Adds the terms that there are, in their order; None if there are none."""
    total = None
    for term in terms:
        total = term if total is None else total if term is None else total + term
    return total


@overload
def convert(function: Callable[[Array], Array], term: Array) -> Array: ...
@overload
def convert(function: Callable[[Array], Array], term: None) -> None: ...
@overload
def convert(function: Callable[[Array], Array], term: Array | None) -> Array | None: ...
def convert(function: Callable[[Array], Array], term: Array | None) -> Array | None:
    """Returns a linear function of a term; None of a term that is absent."""
    return None if term is None else function(term)
