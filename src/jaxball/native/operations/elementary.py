"""Elementary functions in double precision, written with the same instructions for a number or a vector of numbers.

The C library computes one number after another. These functions have no tables, and a branch only for sines of huge
arguments, so that they work equally for all lanes of a vector. Each is an LLVM function, written when it is first
called. Where a comment says exact, this relies on fused multiply-adds, and on no operation being contracted.

Sources: W. J. Cody and W. Waite, Software Manual for the Elementary Functions, 1980, for reductions in several parts;
FDLIBM (Sun Microsystems, 1993) for the coefficients of sin, cos, log and atan; T. J. Dekker, Numer. Math. 18, 1971,
for sums and products of pairs.
"""

import functools
import math
from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np

from ..builder import Builder
from ..elements import Element, Lanes, Name, written

DOUBLE = np.dtype(float)
_LARGEST_ANGLE = 2.0**30  # of which the reduction below is right; larger ones are left to C's library
_SHIFT = 1.5 * 2.0**52  # added to a number, it rounds it to an integer, which is then in the lowest bits

# π/2 and ln 2 as sums of numbers; the first part of the latter has zeros at its end, so that its multiples are exact.
_HALF_PI = (
    float.fromhex("0x1.921fb54442d18p0"),
    float.fromhex("0x1.1a62633145c07p-54"),
    float.fromhex("-0x1.f1976b7ed8fbcp-110"),
)
_LN2 = (float.fromhex("0x1.62e42fee00000p-1"), float.fromhex("0x1.a39ef35793c76p-33"))
_LN2_NEAREST = (float.fromhex("0x1.62e42fefa39efp-1"), float.fromhex("0x1.abc9e3b39803fp-56"))

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
_LOG = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
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
_EXP = tuple(1 / math.factorial(k) for k in range(2, 14))  # (eʳ − 1 − r)/r², of |r| ≤ ln 2/2 to 3e-17


class Writer:
    """Writes the instructions of one function, of ``lanes`` numbers each; one number is none in a vector."""

    def __init__(self, lanes: int):
        self.lanes, self.lines, self._count = lanes, [], 0
        self.label = "entry"

    def type(self, scalar: str) -> str:
        return scalar if self.lanes == 1 else f"<{self.lanes} x {scalar}>"

    @property
    def suffix(self) -> str:
        return "f64" if self.lanes == 1 else f"v{self.lanes}f64"

    def fresh(self) -> str:
        self._count += 1
        return f"%e{self._count}"

    def do(self, instruction: str) -> str:
        name = self.fresh()
        self.lines.append(f"{name} = {instruction}")
        return name

    def text(self, x: str | float | int, kind: str = "double") -> str:
        """A name, or a constant in all lanes."""
        if isinstance(x, str):
            return x
        number = written(np.float64(x)) if kind == "double" else str(int(x))
        return number if self.lanes == 1 else f"splat ({kind} {number})"

    def _operands(self, kind: str, *operands: str | float | int) -> str:
        return ", ".join(self.text(x, kind) for x in operands)

    # Numbers

    def add(self, x: str | float, y: str | float) -> str:
        return self.do(f"fadd {self.type('double')} {self._operands('double', x, y)}")

    def sub(self, x: str | float, y: str | float) -> str:
        return self.do(f"fsub {self.type('double')} {self._operands('double', x, y)}")

    def mul(self, x: str | float, y: str | float) -> str:
        return self.do(f"fmul {self.type('double')} {self._operands('double', x, y)}")

    def div(self, x: str | float, y: str | float) -> str:
        return self.do(f"fdiv {self.type('double')} {self._operands('double', x, y)}")

    def neg(self, x: str) -> str:
        return self.do(f"fneg {self.type('double')} {x}")

    def call(self, name: str, *operands: str | float) -> str:
        """A function that LLVM has instructions for."""
        kind = self.type("double")
        given = ", ".join(f"{kind} {self.text(x)}" for x in operands)
        return self.do(f"call {kind} @llvm.{name}.{self.suffix}({given})")

    def fma(self, x: str | float, y: str | float, z: str | float) -> str:
        """x y + z, rounded once."""
        return self.call("fma", x, y, z)

    def compare(self, predicate: str, x: str | float, y: str | float) -> str:
        return self.do(f"fcmp {predicate} {self.type('double')} {self._operands('double', x, y)}")

    def both(self, x: str, y: str) -> str:
        return self.do(f"and {self.type('i1')} {x}, {y}")

    def select(self, condition: str, x: str | float, y: str | float) -> str:
        kind = self.type("double")
        return self.do(f"select {self.type('i1')} {condition}, {kind} {self.text(x)}, {kind} {self.text(y)}")

    # Their bits

    def bits(self, x: str | float) -> str:
        return self.do(f"bitcast {self.type('double')} {self.text(x)} to {self.type('i64')}")

    def number(self, bits: str) -> str:
        return self.do(f"bitcast {self.type('i64')} {bits} to {self.type('double')}")

    def integer(self, operation: str, x: str | int, y: str | int) -> str:
        return self.do(f"{operation} {self.type('i64')} {self._operands('i64', x, y)}")

    def is_set(self, bits: str, mask: int) -> str:
        return self.do(f"icmp ne {self.type('i64')} {self.integer('and', bits, mask)}, {self.text(0, 'i64')}")

    def nearest(self, x: str) -> tuple[str, str]:
        """The integer nearest to a number of less than 2⁵¹: as a number, and in the lowest bits."""
        shifted = self.add(x, _SHIFT)
        return self.sub(shifted, _SHIFT), self.bits(shifted)

    def power_of_two(self, exponent: str) -> str:
        """2ⁿ of an integer −1022 ≤ n ≤ 1023."""
        return self.number(self.integer("shl", self.integer("add", exponent, 1023), 52))

    # Parts of formulas

    def polynomial(self, x: str, coefficients: Sequence[float]) -> str:
        """c₀ + c₁ x + c₂ x² + …, by halves (Estrin, 1960), which a processor computes side by side."""
        terms: list[str | float] = list(coefficients)
        power = x
        while len(terms) > 1:
            pairs = [self.fma(terms[k + 1], power, terms[k]) for k in range(0, len(terms) - 1, 2)]
            terms = [*pairs, *terms[2 * len(pairs) :]]
            if len(terms) > 1:
                power = self.mul(power, power)
        return self.text(terms[0])

    def sum(self, x: str | float, y: str | float) -> tuple[str, str]:
        """x + y and its rounding error, which is exact where |x| ≥ |y| or x = 0."""
        total = self.add(x, y)
        return total, self.sub(y, self.sub(total, x))

    def sum_of_any(self, x: str, y: str) -> tuple[str, str]:
        """x + y and its rounding error (Knuth)."""
        total = self.add(x, y)
        part = self.sub(total, x)
        return total, self.add(self.sub(x, self.sub(total, part)), self.sub(y, part))

    def product(self, x: str, y: str | float) -> tuple[str, str]:
        """x y and its rounding error."""
        result = self.mul(x, y)
        return result, self.fma(x, y, self.neg(result))


Function = Callable[[Writer, "list[str]"], "list[str]"]


def _sin_and_cos(w: Writer, operands: list[str]) -> list[str]:
    """Both, of x = n π/2 + r, |r| ≤ π/4; r is a sum of two numbers."""
    (x,) = operands
    n, quadrant = w.nearest(w.mul(x, 2 / math.pi))
    minus = w.neg(n)
    first = w.fma(minus, _HALF_PI[0], x)  # exact
    second, second_rest = w.product(minus, _HALF_PI[1])
    near, error = w.sum_of_any(first, second)
    r, rest = w.sum(near, w.fma(minus, _HALF_PI[2], w.add(error, second_rest)))
    z = w.mul(r, r)
    cube = w.mul(z, r)
    inner = w.mul(cube, w.polynomial(z, _SIN[1:]))
    inner = w.sub(w.mul(z, w.sub(w.mul(rest, 0.5), inner)), rest)
    sine = w.sub(r, w.sub(inner, w.mul(cube, _SIN[0])))
    half = w.mul(z, 0.5)
    most = w.sub(1.0, half)
    error = w.sub(w.sub(1.0, most), half)
    tail = w.sub(w.mul(w.mul(z, z), w.polynomial(z, _COS)), w.mul(r, rest))
    cosine = w.add(most, w.add(error, tail))
    odd = w.is_set(quadrant, 1)
    sine, cosine = w.select(odd, cosine, sine), w.select(odd, sine, cosine)
    sine = w.select(w.is_set(quadrant, 2), w.neg(sine), sine)
    sine = w.select(w.compare("oeq", x, 0.0), x, sine)
    return [sine, w.select(w.is_set(w.integer("add", quadrant, 1), 2), w.neg(cosine), cosine)]


def _scaled(w: Writer, x: str, exponent: str) -> str:
    """x 2ⁿ, |n| ≤ 1100, rounded once where it is a subnormal number."""
    half = w.integer("ashr", exponent, 1)
    return w.mul(w.mul(x, w.power_of_two(half)), w.power_of_two(w.integer("sub", exponent, half)))


def _exponent(w: Writer, x: str) -> tuple[str, str, str]:
    """n and r, with the rest of r, of x = n ln 2 + r, |r| ≤ ln 2/2."""
    n, shifted = w.nearest(w.mul(x, 1 / math.log(2)))
    minus = w.neg(n)
    first = w.fma(minus, _LN2_NEAREST[0], x)  # exact
    r = w.fma(minus, _LN2_NEAREST[1], first)
    rest = w.fma(minus, _LN2_NEAREST[1], w.sub(first, r))
    return w.integer("sub", shifted, int(np.float64(_SHIFT).view(np.int64))), r, rest


def _between(w: Writer, x: str, low: float, high: float) -> str:
    """x, or the end of an interval beyond which it is; NaN stays."""
    x = w.select(w.compare("olt", x, low), low, x)
    return w.select(w.compare("ogt", x, high), high, x)


def _exp_of_pair(w: Writer, x: str, more: str | None) -> str:
    n, r, rest = _exponent(w, _between(w, x, -800.0, 800.0))
    if more is not None:
        r, rest = w.sum(r, w.add(rest, more))
    tail = w.fma(w.mul(r, r), w.polynomial(r, _EXP), w.fma(rest, r, rest))
    return _scaled(w, w.add(1.0, w.add(r, tail)), n)


def _exp(w: Writer, operands: list[str]) -> list[str]:
    return [_exp_of_pair(w, operands[0], None)]


def _expm1(w: Writer, operands: list[str]) -> list[str]:
    """2ⁿ (eʳ − 1) + 2ⁿ − 1."""
    (x,) = operands
    n, r, rest = _exponent(w, _between(w, x, -60.0, 709.9))
    tail = w.fma(w.mul(r, r), w.polynomial(r, _EXP), w.fma(rest, r, rest))
    # 2ⁿ may be beyond the largest number though the result is not.
    large = w.do(f"icmp sgt {w.type('i64')} {n}, {w.text(1000, 'i64')}")
    n = w.integer("sub", n, w.do(f"zext {w.type('i1')} {large} to {w.type('i64')}"))
    scale = w.power_of_two(n)
    total, error = w.sum(w.sub(scale, w.select(large, 0.5, 1.0)), w.mul(scale, r))
    result = w.mul(w.add(total, w.fma(scale, tail, error)), w.select(large, 2.0, 1.0))
    result = w.select(w.compare("ogt", x, 709.8), math.inf, result)
    return [w.select(w.compare("oeq", x, 0.0), x, result)]


def _mantissa(w: Writer, x: str) -> tuple[str, str]:
    """n and m of x = 2ⁿ m, √½ ≤ m < √2, of a positive number."""
    small = w.compare("olt", x, 2.0**-1022)
    bits = w.bits(w.select(small, w.mul(x, 2.0**54), x))
    above = w.integer("sub", bits, int(np.float64(math.sqrt(0.5)).view(np.int64)))
    n = w.do(f"sitofp {w.type('i64')} {w.integer('ashr', above, 52)} to {w.type('double')}")
    m = w.number(w.integer("sub", bits, w.integer("and", above, -(1 << 52))))
    return w.sub(n, w.select(small, 54.0, 0.0)), m


def _log_beside_ends(w: Writer, x: str, result: str) -> str:
    """The logarithm of 0, of infinity, and of what has none."""
    result = w.select(w.compare("olt", x, math.inf), result, x)
    result = w.select(w.compare("oeq", x, 0.0), -math.inf, result)
    return w.select(w.compare("olt", x, 0.0), math.nan, result)


def _log_of_sum(w: Writer, x: str, more: str | None) -> str:
    """log(x + c) of a small c, given as c/x."""
    n, m = _mantissa(w, x)
    f = w.sub(m, 1.0)
    s = w.div(f, w.add(f, 2.0))
    z = w.mul(s, s)
    half = w.mul(w.mul(f, 0.5), f)
    tail = w.mul(z, w.polynomial(z, _LOG))
    rest = w.mul(n, _LN2[1])
    rest = w.fma(s, w.add(half, tail), rest if more is None else w.add(rest, more))
    return w.sub(w.mul(n, _LN2[0]), w.sub(w.sub(half, rest), f))


def _log(w: Writer, operands: list[str]) -> list[str]:
    return [_log_beside_ends(w, operands[0], _log_of_sum(w, operands[0], None))]


def _log1p(w: Writer, operands: list[str]) -> list[str]:
    (x,) = operands
    y = w.add(x, 1.0)
    large = w.compare("ogt", x, 1.0)
    error = w.select(large, w.sub(1.0, w.sub(y, x)), w.sub(x, w.sub(y, 1.0)))
    result = _log_beside_ends(w, y, _log_of_sum(w, y, w.div(error, y)))
    return [w.select(w.compare("olt", w.call("fabs", x), 2.0**-54), x, result)]


def _log_as_pair(w: Writer, x: str) -> tuple[str, str]:
    """The logarithm of a positive number as a sum of two, to 2⁻⁶⁵ of itself."""
    n, m = _mantissa(w, x)
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


def _pow(w: Writer, operands: list[str]) -> list[str]:
    """exp(y log |x|), with the sign and the exceptions of IEEE 754's pow."""
    x, y = operands
    size = w.call("fabs", x)
    high, low = _log_as_pair(w, size)
    ordinary = w.both(w.compare("ogt", size, 0.0), w.compare("olt", size, math.inf))
    beyond = w.select(w.compare("oeq", size, 0.0), -math.inf, size)
    high, low = w.select(ordinary, high, beyond), w.select(ordinary, low, 0.0)
    power = w.mul(y, high)
    rest = w.fma(y, low, w.fma(y, high, w.neg(power)))
    rest = w.select(w.compare("olt", w.call("fabs", power), 800.0), rest, 0.0)
    result = _exp_of_pair(w, power, rest)
    result = w.select(w.compare("uno", x, y), math.nan, result)
    half = w.mul(y, 0.5)
    whole = w.compare("oeq", w.call("rint", y), y)
    odd = w.both(whole, w.compare("one", w.call("rint", half), half))
    negative = w.do(f"icmp slt {w.type('i64')} {w.bits(x)}, {w.text(0, 'i64')}")
    result = w.select(w.both(negative, odd), w.neg(result), result)
    broken = w.both(w.compare("olt", x, 0.0), w.compare("one", w.call("rint", y), y))
    result = w.select(w.both(broken, ordinary), math.nan, result)
    endless = w.both(w.compare("oeq", size, 1.0), w.compare("oeq", w.call("fabs", y), math.inf))
    result = w.select(endless, 1.0, result)
    result = w.select(w.compare("oeq", x, 1.0), 1.0, result)
    return [w.select(w.compare("oeq", y, 0.0), 1.0, result)]


def _atan2(w: Writer, operands: list[str]) -> list[str]:
    """j π/4 ± arctan q, |q| ≤ √2 − 1: q is the ratio of the smaller to the larger, or turned by π/4."""
    y, x = operands
    height, width = w.call("fabs", y), w.call("fabs", x)
    steep = w.compare("ogt", height, width)
    more, less = w.select(steep, height, width), w.select(steep, width, height)
    endless = w.compare("oeq", more, math.inf)
    less = w.select(endless, w.select(w.compare("oeq", less, math.inf), 1.0, 0.0), less)
    more = w.select(w.compare("oeq", more, 0.0), 1.0, w.select(endless, 1.0, more))
    scale = w.select(w.compare("ogt", more, 2.0**900), 2.0**-200, 1.0)
    scale = w.select(w.compare("olt", more, 2.0**-900), 2.0**200, scale)
    more, less = w.mul(more, scale), w.mul(less, scale)
    turned = w.compare("ogt", less, w.mul(more, math.sqrt(2) - 1))
    above, above_rest = w.sum(w.neg(more), less)
    below, below_rest = w.sum(more, less)
    above, below = w.select(turned, above, less), w.select(turned, below, more)
    above_rest, below_rest = w.select(turned, above_rest, 0.0), w.select(turned, below_rest, 0.0)
    q = w.div(above, below)
    rest = w.add(w.fma(w.neg(q), below, above), w.sub(above_rest, w.mul(q, below_rest)))
    z = w.mul(q, q)
    rest = w.mul(w.div(rest, below), w.sub(1.0, z))
    tail = w.fma(w.mul(q, z), w.polynomial(z, _ATAN), rest)
    backwards = w.do(f"icmp slt {w.type('i64')} {w.bits(x)}, {w.text(0, 'i64')}")
    quarter = w.select(turned, 1.0, 0.0)
    quarter = w.select(steep, w.sub(2.0, quarter), quarter)
    quarter = w.select(backwards, w.sub(4.0, quarter), quarter)
    falls = w.do(f"xor {w.type('i1')} {steep}, {backwards}")
    q, tail = (w.select(falls, w.neg(number), number) for number in (q, tail))
    base, base_rest = w.product(quarter, _HALF_PI[0] / 2)
    base_rest = w.fma(quarter, _HALF_PI[1] / 2, base_rest)
    total, error = w.sum(base, q)
    result = w.add(total, w.add(error, w.add(tail, base_rest)))
    result = w.call("copysign", result, y)
    return [w.select(w.compare("uno", x, y), math.nan, result)]


def _tanh(w: Writer, operands: list[str]) -> list[str]:
    """t/(t + 2), t = exp(2 |x|) − 1."""
    (x,) = operands
    (t,) = _expm1(w, [w.mul(_between(w, w.call("fabs", x), 0.0, 22.0), 2.0)])
    return [w.call("copysign", w.div(t, w.add(t, 2.0)), x)]


FUNCTIONS: dict[str, tuple[Function, int]] = {
    "sincos": (_sin_and_cos, 1),
    "exp": (_exp, 1),
    "expm1": (_expm1, 1),
    "log": (_log, 1),
    "log1p": (_log1p, 1),
    "pow": (_pow, 2),
    "atan2": (_atan2, 2),
    "tanh": (_tanh, 1),
}


def name_of(name: str, lanes: int = 1) -> str:
    """The name of a function in LLVM's IR."""
    return f"@elementary.{name}.{Writer(lanes).suffix}"


@functools.cache
def definition(name: str, lanes: int = 1) -> str:
    """A function in LLVM's IR, with the declarations that it needs."""
    compute, count = FUNCTIONS[name]
    w = Writer(lanes)
    kind = w.type("double")
    given = [f"%x{k}" for k in range(count)]
    results = compute(w, given)
    returned = kind if len(results) == 1 else f"{{ {', '.join([kind] * len(results))} }}"
    if name == "sincos":
        results = _beyond(w, given[0], results)
    result = results[0]
    if len(results) > 1:
        result = "undef"
        for k, number in enumerate(results):
            result = w.do(f"insertvalue {returned} {result}, {kind} {number}, {k}")
    head = f"define internal {returned} {name_of(name, lanes)}({', '.join(f'{kind} {x}' for x in given)})"
    return "\n".join([f"{head} nounwind memory(none) {{", "entry:", *w.lines, f"ret {returned} {result}", "}"])


def declarations(lanes: int = 1) -> dict[str, str]:
    """What the functions call, by name."""
    w = Writer(lanes)
    kind, bits = w.type("double"), w.type("i1")
    found = {}
    for name, count in (("fma", 3), ("fabs", 1), ("rint", 1), ("copysign", 2)):
        symbol = f"@llvm.{name}.{w.suffix}"
        found[symbol] = f"declare {kind} {symbol}({', '.join([kind] * count)})"
    for name in ("sin", "cos"):
        found[f"@{name}"] = f"declare double @{name}(double) nounwind willreturn memory(none)"
    if lanes > 1:
        symbol = f"@llvm.vector.reduce.or.v{lanes}i1"
        found[symbol] = f"declare i1 {symbol}({bits})"
    return found


def called(b: Builder, name: str, *operands: Element, part: int | None = None) -> Name:
    """A call, for vectors where an operand is one, written once for equal operands; ``part`` of several results."""
    width = max((x.width for x in operands if isinstance(x, Lanes)), default=0)
    lanes = width or 1
    for symbol, line in declarations(lanes).items():
        b.module.declared.setdefault(symbol, line)
    b.module.declared.setdefault(name_of(name, lanes), definition(name, lanes))
    kind = Writer(lanes).type("double")
    returned = kind if part is None else f"{{ {kind}, {kind} }}"
    given = ", ".join(f"{kind} {b.operand(DOUBLE, x, width)}" for x in operands)
    result = b.pure(f"call {returned} {name_of(name, lanes)}({given})", width)
    return result if part is None else b.pure(f"extractvalue {returned} {result}, {part}", width)


def _beyond(w: Writer, x: str, results: list[str]) -> list[str]:
    """Sines and cosines of arguments that are too large, by C's library, lane by lane."""
    large = any_large = w.compare("ogt", w.call("fabs", x), _LARGEST_ANGLE)
    if w.lanes > 1:
        any_large = w.do(f"call i1 @llvm.vector.reduce.or.v{w.lanes}i1({w.type('i1')} {large})")
    w.lines += [f"br i1 {any_large}, label %beyond, label %done", "beyond:"]
    others = []
    for name, result in zip(("sin", "cos"), results, strict=True):
        if w.lanes == 1:
            others.append(w.do(f"call double @{name}(double {x})"))
            continue
        vector = "undef"
        for lane in range(w.lanes):
            number = w.do(f"extractelement {w.type('double')} {x}, i32 {lane}")
            number = w.do(f"call double @{name}(double {number})")
            vector = w.do(f"insertelement {w.type('double')} {vector}, double {number}, i32 {lane}")
        others.append(w.select(large, vector, result))  # no lane depends on the others
    w.lines += ["br label %done", "done:"]
    return [
        w.do(f"phi {w.type('double')} [ {result}, %entry ], [ {other}, %beyond ]")
        for result, other in zip(results, others, strict=True)
    ]
