"""Angles as multiples of π/2 and what remains of them.

Small ones by subtracting the multiple (Cody and Waite), as vectors; huge ones lane by lane by multiplying with those
bits of 2/π that matter (M. H. Payne and R. N. Hanek, Radian reduction for trigonometric functions, SIGNUM Newsletter
18, 1983).
"""

import itertools
import math

from ....ir.elements import llvm_type, vector_type
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
