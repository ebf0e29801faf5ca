"""Operations on single complex numbers, as pairs of floating-point numbers."""

from collections.abc import Callable

import numpy as np

from ...ir.elements import Element, Pair, UnsupportedError, in_lanes, part_of
from ...limits import LANES
from ..builder import Builder
from ..values import lane_of
from . import complex_functions, real

DOUBLE = complex_functions.DOUBLE


def _by_parts(compute: Callable[..., Element]) -> Callable[..., Pair]:
    def of_pairs(b: Builder, dtype: np.dtype, *operands: Pair) -> Pair:
        part = part_of(dtype)
        return Pair(
            compute(b, part, *(x.real for x in operands)),
            compute(b, part, *(x.imag for x in operands)),
        )

    return of_pairs


def library(name: str) -> Callable[..., Pair]:
    """Returns a function of C's library, in double precision: C's complex numbers of single precision are passed
    packed.
    """

    def compute(b: Builder, dtype: np.dtype, *operands: Pair) -> Pair:
        part = part_of(dtype)
        if in_lanes(*operands):
            rows = [compute(b, dtype, *(lane_of(b, dtype, x, lane) for x in operands)) for lane in range(LANES)]
            return Pair(b.gather(part, [x.real for x in rows]), b.gather(part, [x.imag for x in rows]))
        parts = [real.convert(b, part, DOUBLE, number) for x in operands for number in (x.real, x.imag)]
        kinds = ", ".join(["double"] * len(parts))
        head = f"declare {{ double, double }} @{name}({kinds}) nounwind willreturn memory(none)"
        b.module.declared.setdefault(f"@{name}", head)
        operand_texts = ", ".join(f"double {b.operand(DOUBLE, number)}" for number in parts)
        result = b.pure(f"call {{ double, double }} @{name}({operand_texts})")
        numbers = (b.pure(f"extractvalue {{ double, double }} {result}, {k}") for k in (0, 1))
        return Pair(*(real.convert(b, DOUBLE, part, number) for number in numbers))

    return compute


def own(name: str, otherwise: Callable[..., Pair]) -> Callable[..., Pair]:
    """Returns a function of :mod:`complex_functions` where there is no C library, else another."""

    def compute(b: Builder, dtype: np.dtype, *operands: Pair) -> Pair:
        if b.module.target.has_library:
            return otherwise(b, dtype, *operands)
        part = part_of(dtype)
        pairs = [Pair(*(real.convert(b, part, DOUBLE, number) for number in (x.real, x.imag))) for x in operands]
        result = complex_functions.compute(b, name, *pairs)
        return Pair(*(real.convert(b, DOUBLE, part, number) for number in (result.real, result.imag)))

    return compute


def multiply(b: Builder, dtype: np.dtype, x: Pair, y: Pair) -> Pair:
    part = part_of(dtype)

    def products(operation: str, first: tuple[Element, Element], second: tuple[Element, Element]) -> Element:
        return b.binary(operation, part, b.binary("mul", part, *first), b.binary("mul", part, *second))

    return Pair(
        products("sub", (x.real, y.real), (x.imag, y.imag)),
        products("add", (x.real, y.imag), (x.imag, y.real)),
    )


def divide(b: Builder, dtype: np.dtype, x: Pair, y: Pair) -> Pair:
    """Divides by Smith's method (1962), so that nothing overflows on the way."""
    part = part_of(dtype)

    def op(operation: str, u: Element, v: Element) -> Element:
        return b.binary(operation, part, u, v)

    sizes = real.absolute(b, part, y.real), real.absolute(b, part, y.imag)
    wide = b.compare("oge", part, *sizes)  # |Re y| ≥ |Im y|
    large, small = b.select(part, wide, y.real, y.imag), b.select(part, wide, y.imag, y.real)
    ratio = op("div", small, large)
    # Of 0/0 there is no ratio, but x/0 has its infinite parts.
    ratio = b.select(part, b.compare("oeq", part, small, part.type(0)), small, ratio)
    divisor = op("add", large, op("mul", small, ratio))
    first, second = b.select(part, wide, x.real, x.imag), b.select(part, wide, x.imag, x.real)
    above = op("add", first, op("mul", second, ratio))
    beside = op("sub", second, op("mul", first, ratio))
    beside = b.select(part, wide, beside, real.negate(b, part, beside))
    return Pair(op("div", above, divisor), op("div", beside, divisor))


def absolute(b: Builder, dtype: np.dtype, x: Pair) -> Element:
    return real.hypot(b, part_of(dtype), x.real, x.imag)


def sign(b: Builder, dtype: np.dtype, x: Pair) -> Pair:
    """Computes z/|z|; 0 for 0."""
    part = part_of(dtype)
    size = absolute(b, dtype, x)
    zero = b.compare("oeq", part, size, part.type(0))
    size = b.select(part, zero, part.type(1), size)
    return Pair(b.binary("div", part, x.real, size), b.binary("div", part, x.imag, size))


def select(b: Builder, dtype: np.dtype, condition: Element, x: Pair, y: Pair) -> Pair:
    part = part_of(dtype)
    return Pair(b.select(part, condition, x.real, y.real), b.select(part, condition, x.imag, y.imag))


def comparison(direction: str, total: bool) -> Callable[..., Element]:
    def compute(b: Builder, dtype: np.dtype, x: Pair, y: Pair) -> Element:
        if direction not in ("EQ", "NE"):
            raise UnsupportedError("An order of complex numbers")
        pairs = (x.real, y.real), (x.imag, y.imag)
        parts = (b.compare(real.ORDERED[direction], part_of(dtype), *pair) for pair in pairs)
        return b.binary("and" if direction == "EQ" else "or", real.BOOL, *parts)

    return compute


def convert(b: Builder, source: np.dtype, target: np.dtype, x: Element) -> Element:
    """Converts to and from complex types: of a complex number the real part."""
    if source.kind != "c":
        return Pair(real.convert(b, source, part_of(target), x), part_of(target).type(0))
    if target.kind == "c":
        return Pair(*(real.convert(b, part_of(source), part_of(target), part) for part in (x.real, x.imag)))
    if target == real.BOOL:
        part = part_of(source)
        parts = (b.compare("une", part, number, part.type(0)) for number in (x.real, x.imag))
        return b.binary("or", target, *parts)
    return real.convert(b, part_of(source), target, x.real)


SCALARS: dict[str, Callable[..., Element]] = {
    "abs": absolute,
    "add": _by_parts(real.add),
    "conj": lambda b, dtype, x: Pair(x.real, real.negate(b, part_of(dtype), x.imag)),
    "divide": divide,
    "imag": lambda b, dtype, x: x.imag,
    "multiply": multiply,
    "negate": _by_parts(real.negate),
    "real": lambda b, dtype, x: x.real,
    "sign": sign,
    "square": lambda b, dtype, x: multiply(b, dtype, x, x),
    "subtract": _by_parts(real.subtract),
}
SCALARS |= {
    name: own(name, library(function))
    for name, function in {
        "acos": "cacos",
        "acosh": "cacosh",
        "asin": "casin",
        "asinh": "casinh",
        "atan": "catan",
        "atanh": "catanh",
        "cosh": "ccosh",
        "cosine": "ccos",
        "exponential": "cexp",
        "log": "clog",
        "power": "cpow",
        "sine": "csin",
        "sinh": "csinh",
        "sqrt": "csqrt",
        "tan": "ctan",
        "tanh": "ctanh",
    }.items()
}
