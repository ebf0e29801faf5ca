"""Writes the instructions of an elementary function, the same for a number or a vector of numbers."""

from collections.abc import Callable, Sequence

import numpy as np

from ....ir.elements import Element, Name, Vector, write_element
from ....ir.module import Module
from ...instructions import BOOL, Instructions

DOUBLE, LONG = np.dtype(np.float64), np.dtype(np.int64)
SHIFT = 1.5 * 2.0**52  # added to a number, it rounds it to an integer, which is then in the lowest bits


class Writer(Instructions):
    """Writes one function, of ``lanes`` numbers each; one number is none in a vector.

    Nothing is folded or contracted here: formulas rely on each rounding.
    """

    def __init__(self, lanes: int):
        super().__init__(Module())
        self.lanes = lanes

    def pure(self, instruction: str, wide: int = 0) -> Name:
        """Writes an instruction where it stands: the functions have blocks, and LLVM finds numbers that are computed
        twice.
        """
        return self.effect(instruction, wide)

    def argument(self, name: str) -> Name:
        """Returns an argument of the function."""
        return name if self.lanes == 1 else Vector(name, self.lanes)

    def everywhere(self, x: float) -> Element:
        """Returns a number in all lanes, where an operation has no other operand that says how many these are."""
        return x if self.lanes == 1 else Vector(f"splat (double {write_element(x)})", self.lanes)

    # Numbers

    def add(self, x: Element, y: Element) -> Name:
        return self.apply("fadd", DOUBLE, x, y)

    def sub(self, x: Element, y: Element) -> Name:
        return self.apply("fsub", DOUBLE, x, y)

    def mul(self, x: Element, y: Element) -> Name:
        return self.apply("fmul", DOUBLE, x, y)

    def div(self, x: Element, y: Element) -> Name:
        return self.apply("fdiv", DOUBLE, x, y)

    def neg(self, x: Name) -> Name:
        return self.apply("fneg", DOUBLE, x)

    def call(self, name: str, *operands: Element) -> Name:
        """Calls a function that LLVM has instructions for."""
        return self.intrinsic(f"llvm.{name}", DOUBLE, *operands)

    def fma(self, x: Element, y: Element, z: Element) -> Name:
        """Computes x y + z, rounded once."""
        return self.call("fma", x, y, z)

    def compare(self, predicate: str, x: Element, y: Element) -> Name:
        return self.apply(f"fcmp {predicate}", DOUBLE, x, y)

    def both(self, x: Name, y: Name) -> Name:
        return self.apply("and", BOOL, x, y)

    def either(self, x: Name, y: Name) -> Name:
        return self.apply("or", BOOL, x, y)

    def select(self, condition: Name, x: Element, y: Element, dtype: np.dtype = DOUBLE) -> Name:
        return self.choose(dtype, condition, x, y)

    # Their bits

    def bits(self, x: Element) -> Name:
        return self.cast("bitcast", DOUBLE, LONG, x)

    def number(self, bits: Name) -> Name:
        return self.cast("bitcast", LONG, DOUBLE, bits)

    def integer(self, operation: str, x: Element, y: Element) -> Name:
        return self.apply(operation, LONG, x, y)

    def is_negative(self, x: Element) -> Name:
        """Returns whether the sign of a number is set, also for −0."""
        return self.integer("icmp slt", self.bits(x), 0)

    def is_set(self, bits: Name, mask: int) -> Name:
        return self.integer("icmp ne", self.integer("and", bits, mask), 0)

    def nearest(self, x: Name) -> tuple[Name, Name]:
        """Finds the integer nearest to a number of less than 2⁵¹: as a number, and in the lowest bits."""
        shifted = self.add(x, SHIFT)
        return self.sub(shifted, SHIFT), self.bits(shifted)

    def power_of_two(self, exponent: Name) -> Name:
        """Computes 2ⁿ for an integer −1022 ≤ n ≤ 1023."""
        return self.number(self.integer("shl", self.integer("add", exponent, 1023), 52))

    # Parts of formulas

    def polynomial(self, x: str, coefficients: Sequence[float]) -> str:
        """Computes c₀ + c₁ x + c₂ x² + …, by halves (Estrin, 1960), which a processor computes side by side."""
        terms: list[Element] = list(coefficients)
        power = x
        while len(terms) > 1:
            pairs = [self.fma(terms[k + 1], power, terms[k]) for k in range(0, len(terms) - 1, 2)]
            terms = [*pairs, *terms[2 * len(pairs) :]]
            if len(terms) > 1:
                power = self.mul(power, power)
        return terms[0]

    def sum(self, x: Element, y: Element) -> tuple[str, str]:
        """Computes x + y and its rounding error, which is exact where |x| ≥ |y| or x = 0."""
        total = self.add(x, y)
        return total, self.sub(y, self.sub(total, x))

    def sum_of_any(self, x: Element, y: Element) -> tuple[str, str]:
        """Computes x + y and its rounding error (Knuth)."""
        total = self.add(x, y)
        part = self.sub(total, x)
        return total, self.add(self.sub(x, self.sub(total, part)), self.sub(y, part))

    def product(self, x: str, y: Element) -> tuple[str, str]:
        """Computes x y and its rounding error."""
        result = self.mul(x, y)
        return result, self.fma(x, y, self.neg(result))

    def quotient(self, x: str, x_rest: str | None, y: str, y_rest: str) -> tuple[str, str]:
        """Computes (x + x′)/(y + y′) as a sum of two."""
        result = self.div(x, y)
        rest = self.fma(self.neg(result), y, x)
        rest = self.sub(rest if x_rest is None else self.add(rest, x_rest), self.mul(result, y_rest))
        return result, self.div(rest, y)

    def root(self, x: str, x_rest: str) -> tuple[str, str]:
        """Computes √(x + x′) as a sum of two; 0 for 0."""
        result = self.call("sqrt", x)
        rest = self.add(self.fma(self.neg(result), result, x), x_rest)
        return result, self.div(rest, self.select(self.compare("oeq", x, 0.0), 1.0, self.mul(result, 2.0)))


Function = Callable[[Writer, "list[str]"], "list[str]"]


def scale(w: Writer, x: str, exponent: str) -> str:
    """Computes x 2ⁿ, |n| ≤ 1100, rounded once where it is a subnormal number."""
    half = w.integer("ashr", exponent, 1)
    return w.mul(w.mul(x, w.power_of_two(half)), w.power_of_two(w.integer("sub", exponent, half)))


def clamp(w: Writer, x: str, low: float, high: float) -> str:
    """Returns x, or the end of an interval beyond which it is; NaN stays."""
    x = w.select(w.compare("olt", x, low), low, x)
    return w.select(w.compare("ogt", x, high), high, x)
