"""exp, log and pow, sinh, cosh, tanh and their inverses."""

import math
from fractions import Fraction

import numpy as np

from ...instructions import BOOL
from .writer import DOUBLE, LONG, SHIFT, Writer, clamp, scale

_LN2 = (float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33"))
_LN2_NEAREST = (float.fromhex("0x1.62e42fefa39efp-1"), float.fromhex("0x1.abc9e3b39803fp-56"))
_LOG = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)
_EXP = tuple(1 / math.factorial(k) for k in range(2, 14))  # (eʳ − 1 − r)/r², of |r| ≤ ln 2/2 to 3e-17
_SINH = tuple(1 / math.factorial(k) for k in range(3, 21, 2))  # (sinh x − x)/x³ as powers of x², |x| ≤ 1, to 2⁻⁵⁷
_AS_ITSELF = 2.0**-28  # below it, asinh and atanh are the argument to 2⁻⁵⁷ of it


def _exponent(w: Writer, x: str) -> tuple[str, str, str]:
    """Computes n and r, with the rest of r, of x = n ln 2 + r, |r| ≤ ln 2/2."""
    n, shifted = w.nearest(w.mul(x, 1 / math.log(2)))
    minus = w.neg(n)
    first = w.fma(minus, _LN2_NEAREST[0], x)  # exact
    r = w.fma(minus, _LN2_NEAREST[1], first)
    rest = w.fma(minus, _LN2_NEAREST[1], w.sub(first, r))
    return w.integer("sub", shifted, int(np.float64(SHIFT).view(np.int64))), r, rest


def exp_of_pair(w: Writer, x: str, more: str | None) -> str:
    """Computes the exponential of a sum of two numbers, of which the second is small, or None."""
    # Beyond, the result is 0 or infinite all the same, and n would not fit into the bits of two exponents.
    n, r, rest = _exponent(w, clamp(w, x, -800.0, 800.0))
    if more is not None:
        r, rest = w.sum(r, w.add(rest, more))
    tail = w.fma(w.mul(r, r), w.polynomial(r, _EXP), w.fma(rest, r, rest))
    return scale(w, w.add(1.0, w.add(r, tail)), n)


def exponential_in_parts(w: Writer, x: str) -> tuple[str, str, str]:
    """Computes eˣ = 2ⁿ (m + m′), √½ ≤ m < √2, of −800 ≤ x ≤ 800."""
    n, r, rest = _exponent(w, x)
    tail = w.fma(w.mul(r, r), w.polynomial(r, _EXP), w.fma(rest, r, rest))
    near, error = w.sum(1.0, r)
    m, m_rest = w.sum(near, w.add(error, tail))
    return n, m, m_rest


def exp(w: Writer, operands: list[str]) -> list[str]:
    return [exp_of_pair(w, operands[0], None)]


def expm1(w: Writer, operands: list[str]) -> list[str]:
    """Computes 2ⁿ (eʳ − 1) + 2ⁿ − 1."""
    (x,) = operands
    n, r, rest = _exponent(w, clamp(w, x, -60.0, 709.9))
    tail = w.fma(w.mul(r, r), w.polynomial(r, _EXP), w.fma(rest, r, rest))
    # 2ⁿ may be beyond the largest number though the result is not.
    large = w.integer("icmp sgt", n, 1000)
    n = w.integer("sub", n, w.cast("zext", BOOL, LONG, large))
    scale = w.power_of_two(n)
    total, error = w.sum(w.sub(scale, w.select(large, 0.5, 1.0)), w.mul(scale, r))
    result = w.mul(w.add(total, w.fma(scale, tail, error)), w.select(large, 2.0, 1.0))
    result = w.select(w.compare("ogt", x, 709.8), math.inf, result)
    return [w.select(w.compare("oeq", x, 0.0), x, result)]


def mantissa(w: Writer, x: str) -> tuple[str, str]:
    """Computes n and m of x = 2ⁿ m, √½ ≤ m < √2, for a positive number."""
    small = w.compare("olt", x, 2.0**-1022)
    bits = w.bits(w.select(small, w.mul(x, 2.0**54), x))
    above = w.integer("sub", bits, int(np.float64(math.sqrt(0.5)).view(np.int64)))
    n = w.cast("sitofp", LONG, DOUBLE, w.integer("ashr", above, 52))
    m = w.number(w.integer("sub", bits, w.integer("and", above, -(1 << 52))))
    return w.sub(n, w.select(small, 54.0, 0.0)), m


def log_beside_ends(w: Writer, x: str, result: str) -> str:
    """Replaces the logarithm of 0, of infinity, and of numbers that have none."""
    result = w.select(w.compare("olt", x, math.inf), result, x)
    result = w.select(w.compare("oeq", x, 0.0), -math.inf, result)
    return w.select(w.compare("olt", x, 0.0), math.nan, result)


def log_of_sum(w: Writer, x: str, more: str | None, doublings: str | None = None) -> str:
    """Computes log((x + c) 2ᵏ) for a small c, given as c/x; ``doublings``: k, else 0."""
    n, m = mantissa(w, x)
    n = n if doublings is None else w.add(n, doublings)
    f = w.sub(m, 1.0)
    s = w.div(f, w.add(f, 2.0))
    z = w.mul(s, s)
    half = w.mul(w.mul(f, 0.5), f)
    tail = w.mul(z, w.polynomial(z, _LOG))
    rest = w.mul(n, _LN2[1])
    rest = w.fma(s, w.add(half, tail), rest if more is None else w.add(rest, more))
    return w.sub(w.mul(n, _LN2[0]), w.sub(w.sub(half, rest), f))


def log(w: Writer, operands: list[str]) -> list[str]:
    return [log_beside_ends(w, operands[0], log_of_sum(w, operands[0], None))]


def log1p(w: Writer, operands: list[str]) -> list[str]:
    (x,) = operands
    y = w.add(x, 1.0)
    large = w.compare("ogt", x, 1.0)
    error = w.select(large, w.sub(1.0, w.sub(y, x)), w.sub(x, w.sub(y, 1.0)))
    result = log_beside_ends(w, y, log_of_sum(w, y, w.div(error, y)))
    return [w.select(w.compare("olt", w.call("fabs", x), 2.0**-54), x, result)]


def log1p_of_pair(w: Writer, u: str, rest: str, x: str) -> str:
    """Computes log(1 + u + u′); of x > 2²⁸, where u may have no number, log(2 x) instead."""
    y, error = w.sum_of_any(1.0, u)
    large = w.compare("ogt", x, 2.0**28)
    more = w.select(large, 0.0, w.div(w.add(error, rest), y))
    y = w.select(large, x, y)
    return log_beside_ends(w, y, log_of_sum(w, y, more, w.select(large, 1.0, 0.0)))


def _log_as_pair(w: Writer, x: str) -> tuple[str, str]:
    """Computes the logarithm of a positive number as a sum of two, to 2⁻⁶⁵ of itself."""
    n, m = mantissa(w, x)
    f = w.sub(m, 1.0)
    above, below = w.sum(2.0, f)
    inverse = w.div(1.0, above)
    s = w.mul(f, inverse)  # the logarithm is 2 s + 2/3 s³ + 2/5 s⁵ + …, s = f/(2 + f)
    rest = w.mul(w.sub(w.fma(w.neg(s), above, f), w.mul(s, below)), inverse)
    z, z_rest = w.product(s, s)
    z_rest = w.fma(w.mul(s, 2.0), rest, z_rest)
    cube, cube_rest = w.product(z, s)
    cube_rest = w.fma(z, rest, w.fma(z_rest, s, cube_rest))
    third, third_rest = w.product(cube, 2 / 3)
    third_rest = w.fma(cube, float(Fraction(2, 3) - Fraction(2 / 3)), w.fma(cube_rest, 2 / 3, third_rest))
    series = w.polynomial(z, [2 / k for k in range(5, 27, 2)])
    total, first = w.sum(w.mul(n, _LN2[0]), w.mul(s, 2.0))
    total, second = w.sum(total, third)
    low = w.fma(w.mul(cube, z), series, w.add(w.add(first, second), w.fma(rest, 2.0, third_rest)))
    return w.sum(total, w.fma(n, _LN2[1], low))


def pow(w: Writer, operands: list[str]) -> list[str]:
    """Computes exp(y log |x|), with the sign and the exceptions of IEEE 754's pow."""
    x, y = operands
    size = w.call("fabs", x)
    high, low = _log_as_pair(w, size)
    ordinary = w.both(w.compare("ogt", size, 0.0), w.compare("olt", size, math.inf))
    beyond = w.select(w.compare("oeq", size, 0.0), -math.inf, size)
    high, low = w.select(ordinary, high, beyond), w.select(ordinary, low, 0.0)
    power = w.mul(y, high)
    rest = w.fma(y, low, w.fma(y, high, w.neg(power)))
    # Of an infinite product the rest is NaN.
    rest = w.select(w.compare("olt", w.call("fabs", power), 800.0), rest, 0.0)
    result = exp_of_pair(w, power, rest)
    result = w.select(w.compare("uno", x, y), math.nan, result)
    half = w.mul(y, 0.5)
    whole = w.compare("oeq", w.call("rint", y), y)
    odd = w.both(whole, w.compare("one", w.call("rint", half), half))
    result = w.select(w.both(w.is_negative(x), odd), w.neg(result), result)
    broken = w.both(w.compare("olt", x, 0.0), w.compare("one", w.call("rint", y), y))
    result = w.select(w.both(broken, ordinary), math.nan, result)
    endless = w.both(w.compare("oeq", size, 1.0), w.compare("oeq", w.call("fabs", y), math.inf))
    result = w.select(endless, 1.0, result)
    result = w.select(w.compare("oeq", x, 1.0), 1.0, result)
    return [w.select(w.compare("oeq", y, 0.0), 1.0, result)]


def _half_sum(w: Writer, size: str, sign: float) -> str:
    """Computes (eˣ ± e⁻ˣ)/2 of x ≥ 0, without cancellation for x ≥ 1 or a sum."""
    n, high, low = exponential_in_parts(w, clamp(w, size, 0.0, 800.0))
    # The second term in units of 2ⁿ; where it is too small to be one, it is too small to matter.
    fewer = w.select(w.compare("ogt", size, 300.0), -1000, w.integer("mul", n, -2), LONG)
    second, rest = w.quotient(w.power_of_two(fewer), None, high, low)
    total, error = w.sum(high, w.mul(second, sign))
    return scale(w, w.add(total, w.add(error, w.fma(rest, sign, low))), w.integer("sub", n, 1))


def sinh(w: Writer, operands: list[str]) -> list[str]:
    """Computes sinh x, by its series where |x| < 1."""
    (x,) = operands
    size = w.call("fabs", x)
    z = w.mul(size, size)
    near = w.fma(w.mul(z, size), w.polynomial(z, _SINH), size)
    return [w.call("copysign", w.select(w.compare("olt", size, 1.0), near, _half_sum(w, size, -1.0)), x)]


def cosh(w: Writer, operands: list[str]) -> list[str]:
    """Computes (eˣ + e⁻ˣ)/2."""
    return [_half_sum(w, w.call("fabs", operands[0]), 1.0)]


def tanh(w: Writer, operands: list[str]) -> list[str]:
    """Computes t/(t + 2), t = exp(2 |x|) − 1."""
    (x,) = operands
    (t,) = expm1(w, [w.mul(clamp(w, w.call("fabs", x), 0.0, 22.0), 2.0)])
    return [w.call("copysign", w.div(t, w.add(t, 2.0)), x)]


def asinh(w: Writer, operands: list[str]) -> list[str]:
    """Computes log(1 + x + x²/(1 + √(1 + x²))) of |x|."""
    (x,) = operands
    size = w.call("fabs", x)
    square, square_rest = w.product(size, size)
    total, error = w.sum_of_any(1.0, square)
    root, root_rest = w.root(total, w.add(error, square_rest))
    below, error = w.sum(root, 1.0)
    ratio, ratio_rest = w.quotient(square, square_rest, below, w.add(error, root_rest))
    u, error = w.sum(size, ratio)
    result = log1p_of_pair(w, u, w.add(error, ratio_rest), size)
    result = w.select(w.compare("olt", size, _AS_ITSELF), size, result)
    return [w.call("copysign", result, x)]


def acosh(w: Writer, operands: list[str]) -> list[str]:
    """Computes log(1 + t + √(t (t + 2))), t = x − 1."""
    (x,) = operands
    t, t_rest = w.sum_of_any(x, -1.0)
    more, error = w.sum_of_any(t, 2.0)
    product, product_rest = w.product(t, more)
    product_rest = w.add(product_rest, w.mul(t, error))
    product_rest = w.fma(t_rest, w.mul(w.add(t, 1.0), 2.0), product_rest)
    root, root_rest = w.root(product, product_rest)
    u, error = w.sum(root, t)
    result = log1p_of_pair(w, u, w.add(error, w.add(root_rest, t_rest)), x)
    return [w.select(w.compare("olt", x, 1.0), math.nan, result)]


def atanh(w: Writer, operands: list[str]) -> list[str]:
    """Computes log(1 + 2 x/(1 − x))/2 of |x|."""
    (x,) = operands
    size = w.call("fabs", x)
    below, error = w.sum_of_any(1.0, w.neg(size))
    u, rest = w.quotient(w.mul(size, 2.0), None, below, error)
    u = w.select(w.compare("oeq", size, 1.0), math.inf, u)
    rest = w.select(w.compare("olt", size, 1.0), rest, 0.0)
    result = w.mul(log1p_of_pair(w, u, rest, size), 0.5)
    result = w.select(w.compare("ogt", size, 1.0), math.nan, result)
    result = w.select(w.compare("olt", size, _AS_ITSELF), size, result)
    return [w.call("copysign", result, x)]
