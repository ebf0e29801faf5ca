"""Cube roots and the length of a vector of two numbers."""

import math

from .exponentials import mantissa
from .writer import Writer

# ∛m, √½ ≤ m ≤ √2, to 1.4e-5 of itself: the polynomial that is equal to it at Chebyshev's points.
_CBRT = (0.45368850939425087, 0.8967392149835332, -0.5237666939884396, 0.20934605121199612, -0.036000192083417926)


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
    exponent = w.do(f"fptosi {w.type('double')} {third} to {w.type('i64')}")
    ordinary = w.both(w.compare("ogt", size, 0.0), w.compare("olt", size, math.inf))
    scale = w.power_of_two(w.select(ordinary, exponent, 0, "i64"))
    return [w.select(ordinary, w.call("copysign", w.mul(y, scale), x), x)]


def hypot(w: Writer, operands: list[str]) -> list[str]:
    """Computes √(x² + y²), with squares and root as sums of two numbers."""
    width, height = (w.call("fabs", x) for x in operands)
    steep = w.compare("ogt", height, width)
    more, less = w.select(steep, height, width), w.select(steep, width, height)
    large, small = w.compare("ogt", more, 2.0**500), w.compare("olt", more, 2.0**-400)
    scale = w.select(large, 2.0**-600, w.select(small, 2.0**600, 1.0))
    back = w.select(large, 2.0**600, w.select(small, 2.0**-600, 1.0))
    first, first_rest = w.product(*[w.mul(more, scale)] * 2)
    second, second_rest = w.product(*[w.mul(less, scale)] * 2)
    total, error = w.sum(first, second)
    root, rest = w.root(total, w.add(error, w.add(first_rest, second_rest)))
    result = w.mul(w.add(root, rest), back)
    endless = w.either(w.compare("oeq", width, math.inf), w.compare("oeq", height, math.inf))
    return [w.select(endless, math.inf, result)]
