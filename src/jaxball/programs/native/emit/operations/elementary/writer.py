"""Writes the instructions of an elementary function, the same for a number or a vector of numbers."""

from collections.abc import Callable, Sequence

import numpy as np

from ....ir.elements import write_element

SHIFT = 1.5 * 2.0**52  # added to a number, it rounds it to an integer, which is then in the lowest bits


class Writer:
    """Writes the instructions of one function, of ``lanes`` numbers each; one number is none in a vector.

    - ``declared``: by name, the lines that declare or define what they call.
    - ``label``: the block that is being written.
    """

    def __init__(self, lanes: int):
        self.lanes, self._count, self.label = lanes, 0, "entry"
        self.lines: list[str] = []
        self.declared: dict[str, str] = {}

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
        number = write_element(np.float64(x)) if kind == "double" else str(int(x))
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
        kind, symbol = self.type("double"), f"@llvm.{name}.{self.suffix}"
        self.declared[symbol] = f"declare {kind} {symbol}({', '.join([kind] * len(operands))})"
        given = ", ".join(f"{kind} {self.text(x)}" for x in operands)
        return self.do(f"call {kind} {symbol}({given})")

    def fma(self, x: str | float, y: str | float, z: str | float) -> str:
        """x y + z, rounded once."""
        return self.call("fma", x, y, z)

    def compare(self, predicate: str, x: str | float, y: str | float) -> str:
        return self.do(f"fcmp {predicate} {self.type('double')} {self._operands('double', x, y)}")

    def both(self, x: str, y: str) -> str:
        return self.do(f"and {self.type('i1')} {x}, {y}")

    def either(self, x: str, y: str) -> str:
        return self.do(f"or {self.type('i1')} {x}, {y}")

    def any(self, condition: str) -> str:
        """Whether a condition holds in any of the lanes."""
        if self.lanes == 1:
            return condition
        symbol, kind = f"@llvm.vector.reduce.or.v{self.lanes}i1", self.type("i1")
        self.declared[symbol] = f"declare i1 {symbol}({kind})"
        return self.do(f"call i1 {symbol}({kind} {condition})")

    def select(self, condition: str, x: str | float, y: str | float, kind: str = "double") -> str:
        of = self.type(kind)
        first, second = self.text(x, kind), self.text(y, kind)
        return self.do(f"select {self.type('i1')} {condition}, {of} {first}, {of} {second}")

    # Their bits

    def bits(self, x: str | float) -> str:
        return self.do(f"bitcast {self.type('double')} {self.text(x)} to {self.type('i64')}")

    def number(self, bits: str) -> str:
        return self.do(f"bitcast {self.type('i64')} {bits} to {self.type('double')}")

    def integer(self, operation: str, x: str | int, y: str | int) -> str:
        return self.do(f"{operation} {self.type('i64')} {self._operands('i64', x, y)}")

    def is_negative(self, x: str | float) -> str:
        """Whether the sign of a number is set, that of −0 too."""
        return self.do(f"icmp slt {self.type('i64')} {self.bits(x)}, {self.text(0, 'i64')}")

    def is_set(self, bits: str, mask: int) -> str:
        return self.do(f"icmp ne {self.type('i64')} {self.integer('and', bits, mask)}, {self.text(0, 'i64')}")

    def nearest(self, x: str) -> tuple[str, str]:
        """The integer nearest to a number of less than 2⁵¹: as a number, and in the lowest bits."""
        shifted = self.add(x, SHIFT)
        return self.sub(shifted, SHIFT), self.bits(shifted)

    def power_of_two(self, exponent: str) -> str:
        """2ⁿ of an integer −1022 ≤ n ≤ 1023."""
        return self.number(self.integer("shl", self.integer("add", exponent, 1023), 52))

    # Blocks

    def branch(self, condition: str, yes: str, no: str) -> None:
        self.lines.append(f"br i1 {condition}, label %{yes}, label %{no}")

    def begin(self, label: str) -> None:
        """Begins a block, to which the one before it leads on if that does not end in a branch."""
        if not self.lines or not self.lines[-1].startswith("br "):
            self.lines.append(f"br label %{label}")
        self.lines.append(f"{label}:")
        self.label = label

    def phi(self, kind: str, *cases: tuple[str, str]) -> str:
        """The number that the block before gives; of each such block, the number and the label."""
        ways = ", ".join(f"[ {number}, %{label} ]" for number, label in cases)
        return self.do(f"phi {self.type(kind)} {ways}")

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

    def sum_of_any(self, x: str | float, y: str | float) -> tuple[str, str]:
        """x + y and its rounding error (Knuth)."""
        total = self.add(x, y)
        part = self.sub(total, x)
        return total, self.add(self.sub(x, self.sub(total, part)), self.sub(y, part))

    def product(self, x: str, y: str | float) -> tuple[str, str]:
        """x y and its rounding error."""
        result = self.mul(x, y)
        return result, self.fma(x, y, self.neg(result))

    def quotient(self, x: str, x_rest: str | None, y: str, y_rest: str) -> tuple[str, str]:
        """(x + x′)/(y + y′) as a sum of two."""
        result = self.div(x, y)
        rest = self.fma(self.neg(result), y, x)
        rest = self.sub(rest if x_rest is None else self.add(rest, x_rest), self.mul(result, y_rest))
        return result, self.div(rest, y)

    def root(self, x: str, x_rest: str) -> tuple[str, str]:
        """√(x + x′) as a sum of two; 0 of 0."""
        result = self.call("sqrt", x)
        rest = self.add(self.fma(self.neg(result), result, x), x_rest)
        return result, self.div(rest, self.select(self.compare("oeq", x, 0.0), 1.0, self.mul(result, 2.0)))


Function = Callable[[Writer, "list[str]"], "list[str]"]


def scale(w: Writer, x: str, exponent: str) -> str:
    """x 2ⁿ, |n| ≤ 1100, rounded once where it is a subnormal number."""
    half = w.integer("ashr", exponent, 1)
    return w.mul(w.mul(x, w.power_of_two(half)), w.power_of_two(w.integer("sub", exponent, half)))


def between(w: Writer, x: str, low: float, high: float) -> str:
    """x, or the end of an interval beyond which it is; NaN stays."""
    x = w.select(w.compare("olt", x, low), low, x)
    return w.select(w.compare("ogt", x, high), high, x)
