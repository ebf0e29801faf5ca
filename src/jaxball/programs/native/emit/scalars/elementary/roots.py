"""Cube roots, the length of a vector of two numbers and its logarithm, and remainders of divisions, which are exact."""

import math

from ....ir.elements import width_of
from .exponentials import log_beside_ends, log_of_sum, mantissa
from .writer import DOUBLE, LONG, Writer, scale

# ∛m, √½ ≤ m ≤ √2, to 1.4e-5 of itself: the polynomial that is equal to it at Chebyshev's points.
_CBRT = (0.45368850939425087, 0.8967392149835332, -0.5237666939884396, 0.20934605121199612, -0.036000192083417926)
_BITS = 52  # of a quotient that are found at once: with one more, it is rounded to a whole number


def cbrt(w: Writer, operands: list[str]) -> list[str]:
    """Computes 2ᵏ ∛f of |x| = 2³ᵏ f: by a polynomial, a step of Halley's method, and one of Newton's."""
    (x,) = operands
    size = w.call("fabs", x)
    n, m = mantissa(w, size)
    third = w.call("rint", w.mul(n, 1 / 3))
    left = w.fma(third, -3.0, n)  # −1, 0 or 1
    above, below = w.compare("ogt", left, 0.0), w.compare("olt", left, 0.0)
    f = w.mul(m, w.select(above, 2.0, w.select(below, 0.5, 1.0)))
    y = w.mul(w.polynomial(m, _CBRT), w.select(above, 2 ** (1 / 3), w.select(below, 0.5 ** (1 / 3), 1.0)))
    cube = w.mul(w.mul(y, y), y)
    y = w.sub(y, w.div(w.mul(y, w.sub(cube, f)), w.fma(cube, 2.0, f)))
    square, square_rest = w.product(y, y)
    cube, cube_rest = w.product(square, y)
    error = w.add(w.sub(cube, f), w.fma(square_rest, y, cube_rest))
    y = w.sub(y, w.div(error, w.mul(square, 3.0)))
    exponent = w.cast("fptosi", DOUBLE, LONG, third)
    ordinary = w.both(w.compare("ogt", size, 0.0), w.compare("olt", size, math.inf))
    power = w.power_of_two(w.select(ordinary, exponent, 0, LONG))
    return [w.select(ordinary, w.call("copysign", w.mul(y, power), x), x)]


def _squares(w: Writer, x: str, y: str) -> tuple[list[str], list[str], str, str]:
    """Computes the squares of the larger and of the smaller, and their rests, scaled where the larger one is extreme.

    Also gives whether the scale is 2⁻⁶⁰⁰, and whether 2⁶⁰⁰.
    """
    width, height = w.call("fabs", x), w.call("fabs", y)
    steep = w.compare("ogt", height, width)
    more, less = w.select(steep, height, width), w.select(steep, width, height)
    large, small = w.compare("ogt", more, 2.0**500), w.compare("olt", more, 2.0**-400)
    factor = w.select(large, 2.0**-600, w.select(small, 2.0**600, 1.0))
    pairs = [w.product(number, number) for number in (w.mul(more, factor), w.mul(less, factor))]
    return [square for square, _ in pairs], [rest for _, rest in pairs], large, small


def _or_endless(w: Writer, operands: list[str], result: str) -> str:
    """Replaces the result by infinity where one of the operands is infinite, even if the other is no number."""
    first, second = (w.compare("oeq", w.call("fabs", x), math.inf) for x in operands)
    return w.select(w.either(first, second), math.inf, result)


def hypot(w: Writer, operands: list[str]) -> list[str]:
    """Computes √(x² + y²), with squares and root as sums of two numbers."""
    squares, rests, large, small = _squares(w, *operands)
    total, error = w.sum(*squares)
    root, rest = w.root(total, w.add(error, w.add(*rests)))
    back = w.select(large, 2.0**600, w.select(small, 2.0**-600, 1.0))
    return [_or_endless(w, operands, w.mul(w.add(root, rest), back))]


def log_hypot(w: Writer, operands: list[str]) -> list[str]:
    """Computes log(x² + y²)/2, near 1 from x² + y² − 1, in which nothing cancels but what is exact."""
    squares, rests, large, small = _squares(w, *operands)
    rest, last = w.sum_of_any(*rests)
    total, error = w.sum(*squares)
    above, first_error = w.sum_of_any(squares[0], -1.0)
    above, second_error = w.sum_of_any(above, squares[1])
    above, third_error = w.sum_of_any(above, rest)
    above_rest = w.add(w.add(first_error, second_error), w.add(third_error, last))
    near_total, one_rest = w.sum_of_any(1.0, above)
    shift = w.select(large, 1200.0, w.select(small, -1200.0, 0.0))
    near = w.both(w.compare("ogt", total, 0.25), w.compare("olt", total, 4.0))
    near = w.both(near, w.compare("oeq", shift, 0.0))
    y = w.select(near, near_total, total)
    more = w.div(w.select(near, w.add(one_rest, above_rest), w.add(error, rest)), y)
    result = w.mul(log_beside_ends(w, y, log_of_sum(w, y, more, shift)), 0.5)
    return [_or_endless(w, operands, result)]


def fmod(w: Writer, operands: list[str]) -> list[str]:
    """Computes the remainder of x/y with the sign of x: of r = |x|, it subtracts multiples of |y| 2ᵏ, for falling k."""
    x, y = operands
    size, divisor = w.call("fabs", x), w.call("fabs", y)
    divides = w.both(w.compare("olt", size, math.inf), w.compare("ogt", divisor, 0.0))
    shorter = w.compare("olt", size, divisor)
    ordinary = w.both(w.both(divides, w.compare("olt", divisor, math.inf)), w.compare("oge", size, divisor))
    first, unit = w.select(ordinary, size, 0.0), w.select(ordinary, divisor, 1.0)
    unit_exponent = _exponent(w, unit)
    before = w.label
    w.jump("loop")
    w.begin("loop")
    place, r = w.reserve(), w.fresh(width_of(x))
    rest = w.integer("sub", w.integer("sub", _exponent(w, r), unit_exponent), _BITS)
    multiple = scale(w, unit, w.select(w.integer("icmp sgt", rest, 0), rest, 0, LONG))
    times = w.call("trunc", w.div(r, multiple))  # at most one too many
    left = w.fma(w.neg(times), multiple, r)  # exact
    left = w.select(w.compare("olt", left, 0.0), w.add(left, multiple), left)
    w.fill_phi(place, r, DOUBLE, [(first, before), (left, "loop")])
    w.branch(w.any_lane(w.compare("oge", left, unit)), "loop", "end")
    w.begin("end")
    result = w.select(w.both(divides, shorter), size, w.select(ordinary, left, math.nan))
    return [w.call("copysign", result, x)]


def _exponent(w: Writer, x: str) -> str:
    """Computes n of 2ⁿ ≤ x < 2ⁿ⁺¹, and less than any other of 0."""
    small = w.compare("olt", x, 2.0**-1022)
    bits = w.bits(w.select(small, w.mul(x, 2.0**54), x))
    return w.integer("sub", w.integer("lshr", bits, 52), w.select(small, 1023 + 54, 1023, LONG))
