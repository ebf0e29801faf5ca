"""The remainder of a division, which is exact."""

import math

from ....ir.elements import width_of
from .writer import DOUBLE, LONG, Writer, scale

_BITS = 52  # of a quotient that are found at once: with one more, it is rounded to a whole number


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
