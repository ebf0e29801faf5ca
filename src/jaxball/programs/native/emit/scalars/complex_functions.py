"""Elementary functions of complex numbers in double precision, composed of the real ones in :mod:`elementary`.

Each part is right to three units of its own last place, except in powers. On a branch cut the sign of zero chooses the
side. For infinite arguments the parts are what C99 says; where it says NaN for one of them, both may be NaN.

Sources: W. Kahan, Branch cuts for complex elementary functions, in The State of the Art in Numerical Analysis, 1987,
for the inverse functions and tanh; C99, annex G, for the symmetries.
"""

import math
from collections.abc import Callable

import numpy as np

from ...ir.elements import Element, Pair
from ..builder import Builder
from . import elementary

DOUBLE = elementary.DOUBLE
_FACTOR = 700.0  # exponentials of more are computed as those of the rest, times one of this


class _Numbers:
    """Operations on real numbers in double precision, by their signs."""

    def __init__(self, builder: Builder):
        self.builder = builder

    def add(self, x: Element, y: Element) -> Element:
        return self.builder.binary("add", DOUBLE, x, y)

    def sub(self, x: Element, y: Element) -> Element:
        return self.builder.binary("sub", DOUBLE, x, y)

    def mul(self, x: Element, y: Element) -> Element:
        return self.builder.binary("mul", DOUBLE, x, y)

    def div(self, x: Element, y: Element) -> Element:
        return self.builder.binary("div", DOUBLE, x, y)

    def neg(self, x: Element) -> Element:
        return self.builder.negative(DOUBLE, x)

    def size(self, x: Element) -> Element:
        return self.builder.call("llvm.fabs", DOUBLE, x)

    def with_sign(self, x: Element, like: Element) -> Element:
        return self.builder.call("llvm.copysign", DOUBLE, x, like)

    def root(self, x: Element) -> Element:
        return self.builder.call("llvm.sqrt", DOUBLE, x)

    def compare(self, predicate: str, x: Element, y: float) -> Element:
        return self.builder.compare(predicate, DOUBLE, x, DOUBLE.type(y))

    def both(self, first: Element, second: Element) -> Element:
        return self.builder.binary("and", np.dtype(bool), first, second)

    def select(self, condition: Element, x: Element, y: Element) -> Element:
        return self.builder.select(DOUBLE, condition, x, y)

    def function(self, name: str, *operands: Element) -> Element:
        return elementary.write_call(self.builder, name, *operands)

    def sin_and_cos(self, x: Element) -> tuple[Element, Element]:
        sine, cosine = (elementary.write_call(self.builder, "sincos", x, part=part) for part in (0, 1))
        return sine, cosine


def _number(x: float) -> Element:
    return DOUBLE.type(x)


_0, _1, _2, _HALF = map(_number, (0.0, 1.0, 2.0, 0.5))
_EXP_FACTOR = _number(math.exp(_FACTOR))


def _times_i(z: Pair, numbers: _Numbers) -> Pair:
    return Pair(numbers.neg(z.imag), z.real)


def _times_minus_i(z: Pair, numbers: _Numbers) -> Pair:
    return Pair(z.imag, numbers.neg(z.real))


def _product(c: _Numbers, x: Pair, y: Pair) -> Pair:
    real = c.sub(c.mul(x.real, y.real), c.mul(x.imag, y.imag))
    return Pair(real, c.add(c.mul(x.real, y.imag), c.mul(x.imag, y.real)))


def exponential(c: _Numbers, z: Pair) -> Pair:
    """Computes eˣ (cos y + i sin y), where eˣ may be beyond the largest number though the result is not."""
    x, y = z.real, z.imag
    large = c.compare("ogt", x, _FACTOR)
    size = c.function("exp", c.select(large, c.sub(x, _number(_FACTOR)), x))
    factor = c.select(large, _EXP_FACTOR, _1)
    sine, cosine = c.sin_and_cos(y)
    real, imag = (c.mul(c.mul(size, number), factor) for number in (cosine, sine))
    # Of a real number, where 0 times an infinite size would be NaN; and of −∞, whose exponential is 0 in any direction.
    imag = c.select(c.compare("oeq", y, 0.0), y, imag)
    nothing = c.both(c.compare("uno", sine, 0.0), c.compare("oeq", x, -math.inf))
    return Pair(_or_undirected(c, x, sine, size, real), c.select(nothing, _0, imag))


def _or_undirected(c: _Numbers, x: Element, sine: Element, size: Element, real: Element) -> Element:
    """Replaces a real part by the size where that has no direction but is 0 or infinite, as x is."""
    undirected = c.both(c.compare("oeq", c.size(x), math.inf), c.compare("uno", sine, 0.0))
    return c.select(undirected, size, real)


def log(c: _Numbers, z: Pair) -> Pair:
    """Computes log |z| + i arg z."""
    return Pair(c.function("log_hypot", z.real, z.imag), c.function("atan2", z.imag, z.real))


def power(c: _Numbers, z: Pair, exponent: Pair) -> Pair:
    """Computes the exponential of w log z, as C's library does."""
    return exponential(c, _product(c, exponent, log(c, z)))


def sqrt(c: _Numbers, z: Pair) -> Pair:
    """Computes t + i y/(2 t) of t² = (|x| + |z|)/2, or |y|/(2 t) ± i t, scaled where |z| is extreme."""
    width, height = c.size(z.real), c.size(z.imag)
    most = c.builder.call("llvm.maxnum", DOUBLE, width, height)
    large, small = c.compare("ogt", most, 2.0**1000), c.compare("olt", most, 2.0**-900)
    # Powers of four, whose roots are exact: back by that root.
    scale = c.select(large, _number(2.0**-4), c.select(small, _number(2.0**120), _1))
    back = c.select(large, _number(2.0**2), c.select(small, _number(2.0**-60), _1))
    x, y = c.mul(width, scale), c.mul(height, scale)
    t = c.root(c.mul(c.add(x, c.function("hypot", x, y)), _HALF))
    other = c.div(y, c.select(c.compare("oeq", t, 0.0), _1, c.mul(t, _2)))
    left = c.compare("olt", z.real, 0.0)
    real, imag = (c.mul(c.select(left, *numbers), back) for numbers in ((other, t), (t, other)))
    endless = c.compare("oeq", height, math.inf)
    real, imag = (c.select(endless, _number(math.inf), number) for number in (real, imag))
    return Pair(real, c.with_sign(imag, z.imag))


def _hyperbolic(c: _Numbers, x: Element) -> tuple[Element, Element, Element]:
    """Computes sinh x and cosh x, and a number that both are to be multiplied by."""
    size = c.size(x)
    large = c.compare("ogt", size, _FACTOR)
    grown = c.mul(c.function("exp", c.sub(size, _number(_FACTOR))), _HALF)
    near = c.select(large, _0, x)
    sine = c.select(large, c.with_sign(grown, x), c.function("sinh", near))
    cosine = c.select(large, grown, c.function("cosh", near))
    return sine, cosine, c.select(large, _EXP_FACTOR, _1)


def sinh(c: _Numbers, z: Pair) -> Pair:
    """Computes sinh x cos y + i cosh x sin y."""
    sine, cosine = c.sin_and_cos(z.imag)
    above, beside, factor = _hyperbolic(c, z.real)
    real, imag = c.mul(c.mul(above, cosine), factor), c.mul(c.mul(beside, sine), factor)
    real = _or_undirected(c, z.real, sine, above, real)
    return Pair(real, c.select(c.compare("oeq", z.imag, 0.0), z.imag, imag))


def cosh(c: _Numbers, z: Pair) -> Pair:
    """Computes cosh x cos y + i sinh x sin y."""
    sine, cosine = c.sin_and_cos(z.imag)
    above, beside, factor = _hyperbolic(c, z.real)
    real, imag = c.mul(c.mul(beside, cosine), factor), c.mul(c.mul(above, sine), factor)
    real = _or_undirected(c, z.real, sine, beside, real)
    nothing = c.mul(c.with_sign(_1, z.real), z.imag)
    return Pair(real, c.select(c.compare("oeq", z.imag, 0.0), nothing, imag))


def tanh(c: _Numbers, z: Pair) -> Pair:
    """Computes (β ρ s + i t)/(1 + β s²), t = tan y, β = 1 + t², s = sinh x, ρ² = 1 + s²; beyond 22, ±1 + …"""
    x, y = z.real, z.imag
    # There 1 − |tanh x| is below a rounding of 1, and the squares of sinh x would overflow in the end.
    large = c.compare("ogt", c.size(x), 22.0)
    t, s = c.function("tan", y), c.function("sinh", c.select(large, _0, x))
    beta, square = c.add(c.mul(t, t), _1), c.mul(s, s)
    below = c.add(c.mul(beta, square), _1)
    real = c.div(c.mul(c.mul(beta, c.root(c.add(square, _1))), s), below)
    sine, cosine = c.sin_and_cos(y)
    shrunk = c.function("exp", c.mul(c.size(x), _number(-2.0)))
    little = c.mul(c.mul(c.mul(sine, cosine), _number(4.0)), shrunk)
    return Pair(c.select(large, c.with_sign(_1, x), real), c.select(large, little, c.div(t, below)))


def _roots(c: _Numbers, first: Pair, second: Pair) -> tuple[Pair, Pair, Pair]:
    """Computes both square roots, and the first one's conjugate times the second."""
    u, v = sqrt(c, first), sqrt(c, second)
    return u, v, _product(c, Pair(u.real, c.neg(u.imag)), v)


def _beside_1(c: _Numbers, z: Pair) -> tuple[Pair, Pair]:
    """Computes 1 − z and 1 + z."""
    return Pair(c.sub(_1, z.real), c.neg(z.imag)), Pair(c.add(z.real, _1), z.imag)


def _is_endless(c: _Numbers, z: Pair) -> Element:
    parts = (c.compare("oeq", c.size(x), math.inf) for x in (z.real, z.imag))
    return c.builder.binary("or", np.dtype(bool), *parts)


def acos(c: _Numbers, z: Pair) -> Pair:
    """Computes 2 arg(Re √(1 + z) + i Re √(1 − z)) + i arsinh Im(conj √(1 + z) √(1 − z))."""
    less, more = _beside_1(c, z)
    u, v, turned = _roots(c, more, less)
    # The roots of an infinite number have no direction; its own angle is the limit.
    endless = _is_endless(c, z)
    angle = c.mul(c.function("atan2", v.real, u.real), _2)
    angle = c.select(endless, c.function("atan2", c.size(z.imag), z.real), angle)
    sine = c.select(endless, c.with_sign(_number(math.inf), c.neg(z.imag)), turned.imag)
    return Pair(angle, c.function("asinh", sine))


def asin(c: _Numbers, z: Pair) -> Pair:
    """Computes arg(Re(√(1 − z) √(1 + z)) + i x) + i arsinh Im(conj √(1 − z) √(1 + z))."""
    u, v, turned = _roots(c, *_beside_1(c, z))
    across = c.sub(c.mul(u.real, v.real), c.mul(u.imag, v.imag))
    endless = _is_endless(c, z)
    across = c.select(endless, c.size(z.imag), across)
    sine = c.select(endless, c.with_sign(_number(math.inf), z.imag), turned.imag)
    return Pair(c.function("atan2", z.real, across), c.function("asinh", sine))


def acosh(c: _Numbers, z: Pair) -> Pair:
    """Computes arsinh Re(conj √(z − 1) √(z + 1)) + 2 i arg(Re √(z + 1) + i Im √(z − 1))."""
    less, more = Pair(c.sub(z.real, _1), z.imag), Pair(c.add(z.real, _1), z.imag)
    u, v, turned = _roots(c, less, more)
    endless = _is_endless(c, z)
    angle = c.mul(c.function("atan2", u.imag, v.real), _2)
    angle = c.select(endless, c.function("atan2", z.imag, z.real), angle)
    return Pair(c.function("asinh", c.select(endless, _number(math.inf), turned.real)), angle)


def atanh(c: _Numbers, z: Pair) -> Pair:
    """Computes log(1 + 4 x/((1 − x)² + y²))/4 of |x|, and half the angle of 1 − x² − y² + 2 i y."""
    x, y = c.size(z.real), z.imag
    length = c.function("hypot", x, y)
    # Its square might overflow, and there the function is 1/z ± i π/2 to rounding.
    far = c.compare("ogt", length, 2.0**100)
    u, v = c.select(far, _0, x), c.select(far, _0, y)
    left = c.sub(_1, u)
    below = c.add(c.mul(left, left), c.mul(v, v))
    real = c.mul(c.function("log1p", c.div(c.mul(u, _number(4.0)), below)), _number(0.25))
    # Next to 1, whose distance has no square.
    height = c.size(y)
    beside = c.both(c.compare("oeq", x, 1.0), c.compare("olt", height, 2.0**-500))
    real = c.select(beside, c.mul(c.sub(_number(math.log(2)), c.function("log", height)), _HALF), real)
    shrunk = c.select(c.compare("oeq", length, math.inf), _0, c.div(c.div(x, length), length))
    real = c.select(far, shrunk, real)
    across = c.sub(c.mul(left, c.add(u, _1)), c.mul(v, v))
    imag = c.mul(c.function("atan2", c.mul(v, _2), across), _HALF)
    imag = c.select(far, c.with_sign(_number(math.pi / 2), y), imag)
    return Pair(c.with_sign(real, z.real), c.select(c.compare("uno", y, 0.0), y, imag))


Function = Callable[..., Pair]


def _turn(function: Function) -> Function:
    """Returns the function −i f(i z): for sinh it is sin, and likewise tan, arcsin and arctan; no numbers cancel,
    because none are added.
    """
    return lambda c, z: _times_minus_i(function(c, _times_i(z, c)), c)


def _turn_back(function: Function) -> Function:
    """Returns the function i f(−i z)."""
    return lambda c, z: _times_i(function(c, _times_minus_i(z, c)), c)


FUNCTIONS: dict[str, Function] = {
    "acos": acos,
    "acosh": acosh,
    "asin": asin,
    "asinh": _turn_back(asin),
    "atan": _turn(atanh),
    "atanh": atanh,
    "cosh": cosh,
    "cosine": lambda c, z: cosh(c, _times_i(z, c)),
    "exponential": exponential,
    "log": log,
    "power": power,
    "sine": _turn(sinh),
    "sinh": sinh,
    "sqrt": sqrt,
    "tan": _turn(tanh),
    "tanh": tanh,
}


def compute(b: Builder, name: str, *operands: Pair) -> Pair:
    """Computes a function by its name in StableHLO."""
    return FUNCTIONS[name](_Numbers(b), *operands)
