"""sin, cos, tan and their inverses."""

import math

from ...instructions import BOOL
from .reduction import HALF_PI, reduce_angle
from .writer import Writer

_SIN = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COS = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
_ATAN = (
    -3.33333333333329318027e-01,
    1.99999999998764832476e-01,
    -1.42857142725034663711e-01,
    1.11111104054623557880e-01,
    -9.09088713343650656196e-02,
    7.69187620504482999495e-02,
    -6.66107313738753120669e-02,
    5.83357013379057348645e-02,
    -4.97687799461593236017e-02,
    3.65315727442169155270e-02,
    -1.62858201153657823623e-02,
)


def _kernels(w: Writer, x: str) -> tuple[str, tuple[str, str], tuple[str, str]]:
    """Computes the quadrant and, of the angle within it, the sine as a − b, and the cosine as a + b."""
    quadrant, r, rest = reduce_angle(w, x)
    z = w.mul(r, r)
    cube = w.mul(z, r)
    inner = w.mul(cube, w.polynomial(z, _SIN[1:]))
    inner = w.sub(w.mul(z, w.sub(w.mul(rest, 0.5), inner)), rest)
    sine = r, w.sub(inner, w.mul(cube, _SIN[0]))
    half = w.mul(z, 0.5)
    most = w.sub(1.0, half)
    error = w.sub(w.sub(1.0, most), half)
    tail = w.sub(w.mul(w.mul(z, z), w.polynomial(z, _COS)), w.mul(r, rest))
    return quadrant, sine, (most, w.add(error, tail))


def sin_and_cos(w: Writer, operands: list[str]) -> list[str]:
    """Computes both from those of the angle within its quadrant."""
    (x,) = operands
    quadrant, sine_pair, cosine_pair = _kernels(w, x)
    sine, cosine = w.sub(*sine_pair), w.add(*cosine_pair)
    odd = w.is_set(quadrant, 1)
    sine, cosine = w.select(odd, cosine, sine), w.select(odd, sine, cosine)
    sine = w.select(w.is_set(quadrant, 2), w.neg(sine), sine)
    # Keeps the sign of −0.
    sine = w.select(w.compare("oeq", x, 0.0), x, sine)
    return [sine, w.select(w.is_set(w.integer("add", quadrant, 1), 2), w.neg(cosine), cosine)]


def tan(w: Writer, operands: list[str]) -> list[str]:
    """Computes the quotient of sine and cosine, each a sum of two numbers."""
    (x,) = operands
    quadrant, (high, less), cosine_pair = _kernels(w, x)
    sine, cosine = w.sum(high, w.neg(less)), w.sum(*cosine_pair)
    odd = w.is_set(quadrant, 1)
    above = (w.select(odd, w.neg(c), s) for s, c in zip(sine, cosine, strict=True))
    below = (w.select(odd, s, c) for s, c in zip(sine, cosine, strict=True))
    result, rest = w.quotient(*above, *below)
    return [w.select(w.compare("oeq", x, 0.0), x, w.add(result, rest))]


def _angle(w: Writer, y: str, x: str | float, y_rest: str | float = 0.0, x_rest: str | float = 0.0) -> str:
    """Computes j π/4 ± arctan q, |q| ≤ √2 − 1: q is the ratio of the smaller to the larger, or turned by π/4.

    A positive one may be a sum of two numbers if x² + y² is 1.
    """
    exact = y_rest == x_rest == 0.0
    height, width = w.call("fabs", y), w.call("fabs", x)
    steep = w.compare("ogt", height, width)
    more, less = w.select(steep, height, width), w.select(steep, width, height)
    endless = w.compare("oeq", more, math.inf)
    # Of infinite operands, the angle of a point on an axis or on the diagonal, as IEEE 754 has it, without ∞/∞.
    less = w.select(endless, w.select(w.compare("oeq", less, math.inf), 1.0, 0.0), less)
    more = w.select(w.compare("oeq", more, 0.0), 1.0, w.select(endless, 1.0, more))
    scale = w.select(w.compare("ogt", more, 2.0**900), 2.0**-200, 1.0)
    scale = w.select(w.compare("olt", more, 2.0**-900), 2.0**200, scale)
    more, less = w.mul(more, scale), w.mul(less, scale)
    turned = w.compare("ogt", less, w.mul(more, math.sqrt(2) - 1))
    above, above_rest = w.sum(w.neg(more), less)
    below, below_rest = w.sum(more, less)
    less_rest: str | float = 0.0
    more_rest: str | float = 0.0
    if not exact:
        more_rest, less_rest = w.select(steep, y_rest, x_rest), w.select(steep, x_rest, y_rest)
        above_rest = w.add(above_rest, w.sub(less_rest, more_rest))
        below_rest = w.add(below_rest, w.add(less_rest, more_rest))
    above, below = w.select(turned, above, less), w.select(turned, below, more)
    above_rest = w.select(turned, above_rest, less_rest)
    below_rest = w.select(turned, below_rest, more_rest)
    q = w.div(above, below)
    rest = w.add(w.fma(w.neg(q), below, above), w.sub(above_rest, w.mul(q, below_rest)))
    z = w.mul(q, q)
    rest = w.mul(w.div(rest, below), w.sub(1.0, z))
    tail = w.fma(w.mul(q, z), w.polynomial(z, _ATAN), rest)
    backwards = w.is_negative(x)
    # The multiple of π/4 that was taken off, by selects: lanes may need different ones.
    quarter = w.select(turned, 1.0, 0.0)
    quarter = w.select(steep, w.sub(2.0, quarter), quarter)
    quarter = w.select(backwards, w.sub(4.0, quarter), quarter)
    falls = w.apply("xor", BOOL, steep, backwards)
    q, tail = (w.select(falls, w.neg(number), number) for number in (q, tail))
    base, base_rest = w.product(quarter, HALF_PI[0] / 2)
    base_rest = w.fma(quarter, HALF_PI[1] / 2, base_rest)
    total, error = w.sum(base, q)
    result = w.add(total, w.add(error, w.add(tail, base_rest)))
    result = w.call("copysign", result, y)
    return w.select(w.compare("uno", x, y), math.nan, result)


def atan2(w: Writer, operands: list[str]) -> list[str]:
    """Computes the angle of the point (x, y), as IEEE 754 has it for zeros and infinities."""
    y, x = operands
    return [_angle(w, y, x)]


def atan(w: Writer, operands: list[str]) -> list[str]:
    """Computes the angle of the point (1, x)."""
    return [_angle(w, operands[0], w.everywhere(1.0))]


def _leg(w: Writer, x: str) -> tuple[str, str]:
    """Computes √(1 − x²) as a sum of two numbers; NaN beyond 1."""
    square, rest = w.product(x, x)
    near, error = w.sum_of_any(1.0, w.neg(square))
    return w.root(*w.sum(near, w.sub(error, rest)))


def asin(w: Writer, operands: list[str]) -> list[str]:
    """Computes the angle of the point (√(1 − x²), x)."""
    (x,) = operands
    leg, rest = _leg(w, x)
    return [_angle(w, x, leg, x_rest=rest)]


def acos(w: Writer, operands: list[str]) -> list[str]:
    """Computes the angle of the point (x, √(1 − x²))."""
    (x,) = operands
    leg, rest = _leg(w, x)
    return [_angle(w, leg, x, y_rest=rest)]
