"""sin, cos, tan and their inverses.

Of an angle its multiple of π/2 is taken off first: small ones by subtracting it (Cody and Waite), as vectors; huge ones
lane by lane by multiplying with those bits of 2/π that matter (M. H. Payne and R. N. Hanek, Radian reduction for
trigonometric functions, SIGNUM Newsletter 18, 1983).
"""

import itertools
import math

from ....ir.elements import llvm_type, vector_type
from ...instructions import BOOL
from .writer import DOUBLE, LONG, Writer

_LARGEST_ANGLE = 2.0**30  # of which the subtraction is right

# π/2 as a sum of numbers.
HALF_PI = (
    float.fromhex("0x1.921fb54442d18p0"),
    float.fromhex("0x1.1a62633145c07p-54"),
    float.fromhex("-0x1.f1976b7ed8fbcp-110"),
)
# The first 1,216 bits of 2/π.
BITS = (
    "a2f9836e4e441529fc2757d1f534ddc0db6295993c439041fe5163abdebbc561b7246e3a424dd2e006492eea09d1921c"
    "fe1deb1cb129a73ee88235f52ebb4484e99c7026b45f7e413991d639835339f49c845f8bbdf9283b1ff897ffde05980f"
    "ef2f118b5a0a6d1f6d367ecf27cb09b74f463f669e5fea2d7527bac7ebe5f17b3d0739f78a5292ea6bfb5fb11f8d5d08"
    "56033046fc7b6bab"
)
_TABLE, _HUGE, _REDUCED = "@elementary.bits", "@elementary.reduced", "{ i64, double, double }"
_KINDS = LONG, DOUBLE, DOUBLE
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


def reduce_angle(w: Writer, x: str) -> tuple[str, str, str]:
    """Computes n, in the lowest bits, and r + r′, |r| ≤ π/4, of x = n π/2 + r + r′."""
    n, quadrant = w.nearest(w.mul(x, 2 / math.pi))
    minus = w.neg(n)
    first = w.fma(minus, HALF_PI[0], x)  # exact
    second, second_rest = w.product(minus, HALF_PI[1])
    near, error = w.sum_of_any(first, second)
    r, rest = w.sum(near, w.fma(minus, HALF_PI[2], w.add(error, second_rest)))
    large = w.compare("ogt", w.call("fabs", x), _LARGEST_ANGLE)
    before = w.label
    w.branch(w.any_lane(large), "huge", "reduce_angle")
    w.begin("huge")
    numbers = _huge(w, w.select(large, x, _LARGEST_ANGLE))
    small = (quadrant, r, rest)
    if w.lanes > 1:  # some of which may have small angles
        rows = zip(numbers, small, _KINDS, strict=True)
        numbers = [w.select(large, number, other, kind) for number, other, kind in rows]
    w.jump("reduce_angle")
    w.begin("reduce_angle")
    rows = zip(_KINDS, small, numbers, strict=True)
    quadrant, r, rest = (w.phi(kind, [(number, before), (other, "huge")]) for kind, number, other in rows)
    return quadrant, r, rest


def _huge(w: Writer, x: str) -> list[str]:
    """Calls the function for single numbers, of each lane."""
    w.module.declared |= {_TABLE: _table(), _HUGE: _definition(), **_of_single_numbers().module.declared}
    do = w.effect
    if w.lanes == 1:
        result = do(f"call {_REDUCED} {_HUGE}(double {x})")
        return [do(f"extractvalue {_REDUCED} {result}, {k}") for k in range(3)]
    vectors = ["undef"] * 3
    for lane in range(w.lanes):
        number = do(f"extractelement {vector_type(DOUBLE, w.lanes)} {x}, i32 {lane}")
        result = do(f"call {_REDUCED} {_HUGE}(double {number})")
        for k, kind in enumerate(_KINDS):
            part = f"{llvm_type(kind)} {do(f'extractvalue {_REDUCED} {result}, {k}')}"
            vector = f"{vector_type(kind, w.lanes)} {vectors[k]}"
            vectors[k] = do(f"insertelement {vector}, {part}, i32 {lane}", w.lanes)
    return vectors


def _table() -> str:
    """Writes 2/π as whole numbers of 64 bits, after one that is 0."""
    words = ["0", *(str(int(BITS[k : k + 16], 16)) for k in range(0, len(BITS), 16))]
    numbers = ", ".join(f"i64 {word}" for word in words)
    return f"{_TABLE} = private unnamed_addr constant [{len(words)} x i64] [{numbers}], align 8"


def _definition() -> str:
    """Writes the function for single numbers."""
    return _of_single_numbers().function(f"internal {_REDUCED} {_HUGE}(double %x) nounwind memory(none)")


def _of_single_numbers() -> Writer:
    """Writes the steps: of x = M 2ᵉ, 192 bits of 2/π from that on of which M makes no multiple of 4, times M."""
    w, x = Writer(1), "%x"
    do = w.effect
    bits = w.bits(w.call("fabs", x))
    exponent = w.integer("lshr", bits, 52)
    significand = w.integer("or", w.integer("and", bits, (1 << 52) - 1), 1 << 52)
    # The bit after the point is the one with number 64; e = exponent − 1075, and the first that matters has 2¹⁻ᵉ.
    first = w.integer("sub", exponent, 1075 - 62)
    word, shift = w.integer("lshr", first, 6), w.integer("and", first, 63)
    words = []
    for k in range(4):
        place = do(f"getelementptr i64, ptr {_TABLE}, i64 {w.integer('add', word, k)}")
        words.append(do(f"load i64, ptr {place}, align 8"))
    w.module.declared["@llvm.fshl.i64"] = "declare i64 @llvm.fshl.i64(i64, i64, i64)"
    window = [
        do(f"call i64 @llvm.fshl.i64(i64 {high}, i64 {low}, i64 {shift})") for high, low in itertools.pairwise(words)
    ]
    wide = [do(f"zext i64 {number} to i128") for number in (*window, significand)]
    lowest = do(f"lshr i128 {do(f'mul i128 {wide[2]}, {wide[3]}')}, 64")
    middle = do(f"add i128 {do(f'mul i128 {wide[1]}, {wide[3]}')}, {lowest}")
    highest = do(f"shl i128 {do(f'mul i128 {wide[0]}, {wide[3]}')}, 64")
    product = do(f"add i128 {highest}, {middle}")  # two bits of the whole number, and 126 of the fraction
    fraction = do(f"shl i128 {product}, 2")  # below 0 if more than a half: then it is what the next one is too much
    whole = do(f"trunc i128 {do(f'lshr i128 {product}, 125')} to i64")  # twice, with the first bit of the fraction
    quadrant = w.integer("lshr", w.integer("add", whole, 1), 1)
    highest = do(f"trunc i128 {do(f'ashr i128 {fraction}, 85')} to i64")
    middle = w.integer("and", do(f"trunc i128 {do(f'lshr i128 {fraction}, 42')} to i64"), (1 << 43) - 1)
    lowest = w.integer("and", do(f"trunc i128 {fraction} to i64"), (1 << 42) - 1)
    parts = (do(f"sitofp i64 {number} to double") for number in (highest, middle, lowest))
    high, low, lower = (w.mul(part, 2.0**power) for part, power in zip(parts, (-43, -86, -128), strict=True))
    high, low = w.sum(high, low)  # exact
    low = w.add(low, lower)
    r, error = w.product(high, HALF_PI[0])
    r, rest = w.sum(r, w.fma(high, HALF_PI[1], w.fma(low, HALF_PI[0], error)))
    r = w.add(r, w.sub(x, x))  # no number where x is infinite
    negative = w.is_negative(x)
    r, rest = (w.select(negative, w.neg(number), number) for number in (r, rest))
    quadrant = w.select(negative, w.integer("sub", 0, quadrant), quadrant, LONG)
    result = do(f"insertvalue {_REDUCED} undef, i64 {quadrant}, 0")
    result = do(f"insertvalue {_REDUCED} {result}, double {r}, 1")
    w.write(f"ret {_REDUCED} {do(f'insertvalue {_REDUCED} {result}, double {rest}, 2')}")
    return w


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
