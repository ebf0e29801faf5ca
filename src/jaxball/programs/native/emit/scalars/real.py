"""Operations on single numbers: floating-point numbers, integers and booleans; ``elementwise`` maps them over arrays.

Each function takes the builder, the type of its operands, and the operands. NaN, infinities and signed zeros mean what
StableHLO says, which is what XLA computes.
"""

from collections.abc import Callable

import numpy as np

from ...ir.elements import Element, UnsupportedError, in_lanes, is_known, llvm_type
from ...targets import machine
from ..builder import Builder
from ..instructions import BOOL
from . import elementary


def intrinsic(name: str) -> Callable[..., Element]:
    """Returns a function that LLVM supports."""

    def compute(builder: Builder, dtype: np.dtype, *operands: Element) -> Element:
        if dtype.kind != "f":
            raise UnsupportedError(f"The function {name} of {dtype}")
        return builder.call(f"llvm.{name}", dtype, *operands)

    return compute


def library(name: str) -> Callable[..., Element]:
    """Returns a function of C's library, which has one for each type."""

    def compute(builder: Builder, dtype: np.dtype, *operands: Element) -> Element:
        if dtype.kind != "f":
            raise UnsupportedError(f"The function {name} of {dtype}")
        if not builder.module.target.has_library:
            raise UnsupportedError(f"The function {name} where there is no C library")
        return builder.call(name if dtype.itemsize == 8 else f"{name}f", dtype, *operands)

    return compute


def own(
    name: str, otherwise: Callable[..., Element], part: int | None = None, in_vectors: bool = True
) -> Callable[..., Element]:
    """Returns a function of :mod:`elementary`, or one part of its result, for vectors; for single numbers, another.

    Where there is no C library, it is for these too, and for known ones. Numbers of 32 bits are computed in 64, and
    rounded.

    ``in_vectors``: only there. Of those for single numbers only tanh takes less time than C's library does, which has
    tables: 9 against 11 ns, and 22 against 34 where each waits for the last one. (sin and cos together take 12 against
    11, atan2 16 against 12.)
    """

    def compute(builder: Builder, dtype: np.dtype, *operands: Element) -> Element:
        if dtype.kind != "f":
            raise UnsupportedError(f"The function {name} of {dtype}")
        if builder.module.target.has_library:
            single = not in_lanes(*operands) and (in_vectors or dtype != elementary.DOUBLE)
            if single or all(map(is_known, operands)) or not machine.multiplies_and_adds():
                return otherwise(builder, dtype, *operands)
        numbers = [convert(builder, dtype, elementary.DOUBLE, x) for x in operands]
        result = elementary.write_call(builder, name, *numbers, part=part)
        return convert(builder, elementary.DOUBLE, dtype, result)

    return compute


def add(b: Builder, dtype: np.dtype, x: Element, y: Element) -> Element:
    return b.binary("or" if dtype == BOOL else "add", dtype, x, y)


def subtract(b: Builder, dtype: np.dtype, x: Element, y: Element) -> Element:
    return b.binary("sub", dtype, x, y)


def multiply(b: Builder, dtype: np.dtype, x: Element, y: Element) -> Element:
    return b.binary("and" if dtype == BOOL else "mul", dtype, x, y)


def divide(b: Builder, dtype: np.dtype, x: Element, y: Element) -> Element:
    """Divides x by y: for integers, −1 (all bits set) where y is 0; the least integer divided by −1 is itself."""
    if dtype.kind == "f":
        return b.binary("div", dtype, x, y)
    return _divide(b, "div", dtype, x, y, -1, np.iinfo(dtype).min)


def remainder(b: Builder, dtype: np.dtype, x: Element, y: Element) -> Element:
    """Computes the remainder, with the sign of x. Of integers: x where y is 0."""
    if dtype.kind == "f":
        return _remainder_of_floats(b, dtype, x, y)
    return _divide(b, "rem", dtype, x, y, None, 0)


_remainder_of_floats = own("fmod", lambda b, dtype, x, y: b.apply("frem", dtype, x, y))  # which calls C's library


def _divide(
    b: Builder, operation: str, dtype: np.dtype, x: Element, y: Element, by_zero: int | None, overflowed: int
) -> Element:
    """Divides integers, with the divisor replaced by 1 where LLVM does not define the result."""
    signed = dtype.kind == "i"
    zero = b.compare("eq", dtype, y, dtype.type(0))
    overflow: Element = np.bool_(False)
    if signed:
        least = b.compare("eq", dtype, x, np.iinfo(dtype).min)
        overflow = b.binary("and", BOOL, least, b.compare("eq", dtype, y, dtype.type(-1)))
    divisor = b.select(dtype, b.binary("or", BOOL, zero, overflow), dtype.type(1), y)
    result = b.apply(f"{'s' if signed else 'u'}{operation}", dtype, x, divisor)
    result = b.select(dtype, overflow, dtype.type(overflowed), result)
    return b.select(dtype, zero, x if by_zero is None else np.array(by_zero).astype(dtype)[()], result)


def negate(b: Builder, dtype: np.dtype, x: Element) -> Element:
    if dtype.kind != "f":
        return b.binary("sub", dtype, dtype.type(0), x)
    return b.negative(dtype, x)


def absolute(b: Builder, dtype: np.dtype, x: Element) -> Element:
    if dtype.kind == "f":
        return b.call("llvm.fabs", dtype, x)
    return b.select(dtype, b.compare("slt", dtype, x, dtype.type(0)), negate(b, dtype, x), x)


def sign(b: Builder, dtype: np.dtype, x: Element) -> Element:
    """Returns −1, 0 or 1; NaN and zeros are their own signs."""
    unit, zero = dtype.type(1), dtype.type(0)
    if dtype.kind == "f":
        # Unordered or equal: true of NaN, 0 and −0.
        itself = b.apply("fcmp ueq", dtype, x, zero)
        return b.select(dtype, itself, x, b.call("llvm.copysign", dtype, unit, x))
    above = b.select(dtype, b.compare("eq", dtype, x, zero), zero, unit)
    return above if dtype.kind == "u" else b.select(dtype, b.compare("slt", dtype, x, zero), dtype.type(-1), above)


def _extreme(of_floats: str, of_integers: str, of_booleans: str) -> Callable[..., Element]:
    def compute(b: Builder, dtype: np.dtype, x: Element, y: Element) -> Element:
        if dtype == BOOL:
            return b.binary(of_booleans, dtype, x, y)
        if dtype.kind == "f":  # NaN if either is
            return b.call(f"llvm.{of_floats}", dtype, x, y)
        return b.call(f"llvm.{'u' if dtype.kind == 'u' else 's'}{of_integers}", dtype, x, y)

    return compute


maximum, minimum = _extreme("maximum", "max", "or"), _extreme("minimum", "min", "and")


def clamp(b: Builder, dtype: np.dtype, low: Element, x: Element, high: Element) -> Element:
    return minimum(b, dtype, maximum(b, dtype, x, low), high)


def is_finite(b: Builder, dtype: np.dtype, x: Element) -> Element:
    return b.compare("olt", dtype, absolute(b, dtype, x), dtype.type(np.inf))


def logical(operation: str) -> Callable[..., Element]:
    return lambda b, dtype, x, y: b.binary(operation, dtype, x, y)


def logical_not(b: Builder, dtype: np.dtype, x: Element) -> Element:
    return b.binary("xor", dtype, x, np.bool_(True) if dtype == BOOL else ~dtype.type(0))


def shift(operation: str) -> Callable[..., Element]:
    """Shifts by the number of bits, or more, leave no bit, or the sign."""

    def compute(b: Builder, dtype: np.dtype, x: Element, y: Element) -> Element:
        # Of LLVM's shifts by as many bits or more the result is undefined.
        bits = 8 * dtype.itemsize
        inside = b.compare("ult", np.dtype(f"u{dtype.itemsize}"), y, bits) if not is_known(y) else 0 <= y < bits
        most = bits - 1 if operation == "ashr" else 0
        by = b.select(dtype, inside, y, dtype.type(most))
        shifted = b.apply(operation, dtype, x, by)
        return shifted if operation == "ashr" else b.select(dtype, inside, shifted, dtype.type(0))

    return compute


def population_count(b: Builder, dtype: np.dtype, x: Element) -> Element:
    return b.call("llvm.ctpop", dtype, x)


def leading_zeros(b: Builder, dtype: np.dtype, x: Element) -> Element:
    return b.call("llvm.ctlz", dtype, x, flags="i1 false")


def rsqrt(b: Builder, dtype: np.dtype, x: Element) -> Element:
    return b.binary("div", dtype, dtype.type(1), intrinsic("sqrt")(b, dtype, x))


hypot = own("hypot", library("hypot"))


def logistic(b: Builder, dtype: np.dtype, x: Element) -> Element:
    unit = dtype.type(1)
    grown = SCALARS["exponential"](b, dtype, negate(b, dtype, x))
    return b.binary("div", dtype, unit, b.binary("add", dtype, unit, grown))


def square(b: Builder, dtype: np.dtype, x: Element) -> Element:
    return multiply(b, dtype, x, x)


ORDERED = {"EQ": "oeq", "NE": "une", "LT": "olt", "LE": "ole", "GT": "ogt", "GE": "oge"}
SIGNED = {"EQ": "eq", "NE": "ne", "LT": "slt", "LE": "sle", "GT": "sgt", "GE": "sge"}
UNSIGNED = {"EQ": "eq", "NE": "ne", "LT": "ult", "LE": "ule", "GT": "ugt", "GE": "uge"}


def comparison(direction: str, total: bool) -> Callable[..., Element]:
    """Returns a comparison; ``total``: by IEEE 754's total order, −NaN < −∞ < … < −0 < +0 < … < ∞ < NaN."""

    def compute(b: Builder, dtype: np.dtype, x: Element, y: Element) -> Element:
        if dtype.kind == "f" and total:
            integer = np.dtype(f"i{dtype.itemsize}")
            x, y = (_in_order(b, dtype, integer, z) for z in (x, y))
            return b.compare(SIGNED[direction], integer, x, y)
        predicates = ORDERED if dtype.kind == "f" else SIGNED if dtype.kind == "i" else UNSIGNED
        return b.compare(predicates[direction], dtype, x, y)

    return compute


def next_after(b: Builder, dtype: np.dtype, x: Element, y: Element) -> Element:
    """Computes the number next to x in the direction of y: y where they are equal, and NaN if either is."""
    integer = np.dtype(f"i{dtype.itemsize}")
    bits = bitcast(b, dtype, integer, x)
    # Numbers of one sign are in the order of their bits, so that the next one's are one more or one less.
    outwards = b.compare("eq", BOOL, b.compare("olt", dtype, x, y), b.compare("sge", integer, bits, integer.type(0)))
    step = b.select(integer, outwards, integer.type(1), integer.type(-1))
    moved = bitcast(b, integer, dtype, b.binary("add", integer, bits, step))
    # Beside 0 the sign may change, and the bits with it.
    least = b.call("llvm.copysign", dtype, np.finfo(dtype).smallest_subnormal, y)
    moved = b.select(dtype, b.compare("oeq", dtype, x, dtype.type(0)), least, moved)
    moved = b.select(dtype, b.compare("oeq", dtype, x, y), y, moved)
    return b.select(dtype, b.apply("fcmp uno", dtype, x, y), b.binary("add", dtype, x, y), moved)


def _in_order(b: Builder, dtype: np.dtype, integer: np.dtype, x: Element) -> Element:
    """Returns an integer that is ordered as the number is."""
    bits = bitcast(b, dtype, integer, x)
    # The bits of negative numbers grow as these fall: all but the sign are inverted.
    sign = b.apply("ashr", integer, bits, integer.type(8 * integer.itemsize - 1))
    return b.apply("xor", integer, bits, b.apply("lshr", integer, sign, integer.type(1)))


def bitcast(b: Builder, source: np.dtype, target: np.dtype, x: Element) -> Element:
    """Returns the number with the same bits."""
    if source.itemsize != target.itemsize or "b" in (source.kind, target.kind) or "c" in (source.kind, target.kind):
        raise UnsupportedError(f"Bits of {source} as {target}")
    if llvm_type(source) == llvm_type(target):
        return np.asarray(x).view(target)[()] if is_known(x) else x
    return b.convert("bitcast", source, target, x)


def convert(b: Builder, source: np.dtype, target: np.dtype, x: Element) -> Element:
    """Converts a number to the nearest of another type; where there is none, the last one, and for NaN 0."""
    if source == target:
        return x
    if is_known(x) and (source.kind != "f" or target.kind == "f"):
        with np.errstate(all="ignore"):
            return np.asarray(x).astype(target)[()]
    if target == BOOL:
        return b.compare("une" if source.kind == "f" else "ne", source, x, source.type(0))
    if source.kind == "f" and target.kind == "f":
        return b.convert("fpext" if target.itemsize > source.itemsize else "fptrunc", source, target, x)
    if source.kind == "f":
        # Without saturation, numbers beyond the range have no defined result.
        return b.call(f"llvm.fpto{'s' if target.kind == 'i' else 'u'}i.sat", source, x, to=target)
    if target.kind == "f":
        return b.convert("sitofp" if source.kind == "i" else "uitofp", source, target, x)
    if source != BOOL and source.itemsize == target.itemsize:
        return x
    if source != BOOL and source.itemsize > target.itemsize:
        return b.convert("trunc", source, target, x)
    return b.convert("sext" if source.kind == "i" else "zext", source, target, x)


def reduce_precision(b: Builder, dtype: np.dtype, x: Element, exponent: int, mantissa: int) -> Element:
    """Rounds to a number of bits, ties to even; beyond the range of exponents to infinity or a signed zero."""
    own_exponent, own_mantissa = {8: (11, 52), 4: (8, 23)}[dtype.itemsize]
    exponent, mantissa = min(exponent, own_exponent), min(mantissa, own_mantissa)
    integer = np.dtype(f"u{dtype.itemsize}")
    rounded: Element = x
    if mantissa < own_mantissa:
        bits, dropped = bitcast(b, dtype, integer, x), own_mantissa - mantissa
        # Half a unit less one, and one more if the last bit kept is set: ties go to even. A carry into the exponent is
        # right.
        last = b.binary("and", integer, b.apply("lshr", integer, bits, integer.type(dropped)), integer.type(1))
        bits = b.binary("add", integer, bits, b.binary("add", integer, last, integer.type((1 << (dropped - 1)) - 1)))
        bits = b.binary("and", integer, bits, ~integer.type((1 << dropped) - 1))
        rounded = bitcast(b, integer, dtype, bits)
    bias = 2 ** (exponent - 1) - 1
    most, least = dtype.type((2 - 2.0**-mantissa) * 2.0**bias), dtype.type(2.0 ** (1 - bias))
    size = absolute(b, dtype, rounded)
    if exponent < own_exponent:
        sign_of = lambda number: b.call("llvm.copysign", dtype, dtype.type(number), x)  # noqa: E731
        rounded = b.select(dtype, b.compare("ogt", dtype, size, most), sign_of(np.inf), rounded)
        rounded = b.select(dtype, b.compare("olt", dtype, size, least), sign_of(0.0), rounded)
    return b.select(dtype, b.apply("fcmp uno", dtype, x, x), x, rounded)


def select(b: Builder, dtype: np.dtype, condition: Element, x: Element, y: Element) -> Element:
    return b.select(dtype, condition, x, y)


SCALARS: dict[str, Callable[..., Element]] = {
    "abs": absolute,
    "add": add,
    "and": logical("and"),
    "ceil": intrinsic("ceil"),
    "cosine": own("sincos", intrinsic("cos"), 1),
    "count_leading_zeros": leading_zeros,
    "divide": divide,
    "exponential": own("exp", intrinsic("exp")),
    "floor": intrinsic("floor"),
    "is_finite": is_finite,
    "log": own("log", intrinsic("log")),
    "logistic": logistic,
    "maximum": maximum,
    "minimum": minimum,
    "multiply": multiply,
    "negate": negate,
    "next_after": next_after,
    "not": logical_not,
    "or": logical("or"),
    "popcnt": population_count,
    "power": own("pow", intrinsic("pow")),
    "remainder": remainder,
    "round_nearest_afz": intrinsic("round"),
    "round_nearest_even": intrinsic("roundeven"),
    "rsqrt": rsqrt,
    "shift_left": shift("shl"),
    "shift_right_arithmetic": shift("ashr"),
    "shift_right_logical": shift("lshr"),
    "sign": sign,
    "sine": own("sincos", intrinsic("sin"), 0),
    "sqrt": intrinsic("sqrt"),
    "square": square,
    "subtract": subtract,
    "tanh": own("tanh", library("tanh"), in_vectors=False),
    "xor": logical("xor"),
}
# By C's names.
SCALARS |= {
    name: own(function, library(function))
    for name, function in {
        "acos": "acos",
        "acosh": "acosh",
        "asin": "asin",
        "asinh": "asinh",
        "atan": "atan",
        "atan2": "atan2",
        "atanh": "atanh",
        "cbrt": "cbrt",
        "cosh": "cosh",
        "erf": "erf",
        "erfc": "erfc",
        "exponential_minus_one": "expm1",
        "log_plus_one": "log1p",
        "sinh": "sinh",
        "tan": "tan",
    }.items()
}
