"""sinh, cosh, tanh and their inverses."""

import math

from .exponentials import expm1, exponential_in_parts, log1p_of_pair
from .writer import LONG, Writer, clamp, scale

_SINH = tuple(1 / math.factorial(k) for k in range(3, 21, 2))  # (sinh x − x)/x³ as powers of x², |x| ≤ 1, to 2⁻⁵⁷
_AS_ITSELF = 2.0**-28  # below it, asinh and atanh are the argument to 2⁻⁵⁷ of it


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
