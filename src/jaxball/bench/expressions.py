"""Equations of scalars as expressions, in which what occurs twice is computed once, and their derivatives."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

Operand: TypeAlias = "Expression | float | int"
COMMUTATIVE = ("+", "*")


class Expression:
    """A number that is given by name, ``("x[0]",)``, or the result of an operation on others, ``("+", a, b)``.

    Expressions of one program share ``known``, all of them by operation and operands.
    """

    def __init__(self, known: dict[Any, "Expression"], operation: str, operands: tuple[Operand, ...] = ()):
        self.known, self.operation, self.operands = known, operation, operands

    def __add__(self, other: Operand) -> Operand:
        return _operation("+", self, other)

    def __sub__(self, other: Operand) -> Operand:
        return _operation("-", self, other)

    def __mul__(self, other: Operand) -> Operand:
        return _operation("*", self, other)

    def __truediv__(self, other: Operand) -> Operand:
        return _operation("/", self, other)

    def __radd__(self, other: float | int) -> Operand:
        return _operation("+", other, self)

    def __rsub__(self, other: float | int) -> Operand:
        return _operation("-", other, self)

    def __rmul__(self, other: float | int) -> Operand:
        return _operation("*", other, self)

    def __rtruediv__(self, other: float | int) -> Operand:
        return _operation("/", other, self)

    def __neg__(self) -> Operand:
        return _made(self.known, "-", self)


class FunctionsOfExpressions:
    """The functions that equations may call, of expressions and of known numbers."""

    @staticmethod
    def sin(x: Operand) -> Operand:
        """The sine."""
        return _made(x.known, "sin", x) if isinstance(x, Expression) else math.sin(x)

    @staticmethod
    def cos(x: Operand) -> Operand:
        """The cosine."""
        return _made(x.known, "cos", x) if isinstance(x, Expression) else math.cos(x)


def given(names: Sequence[str]) -> list[Expression]:
    """The numbers with these names, of one program."""
    known: dict[Any, Expression] = {}
    return [_made(known, name) for name in names]


def in_order(results: Sequence[Operand]) -> Iterator[Expression]:
    """The operations that results need, each after those that it needs itself."""
    seen: set[Expression] = set()
    for root in results:
        stack = [root]
        while stack:
            last = stack[-1]
            missing = [] if last in seen else [x for x in _expressions(last) if x not in seen]
            stack.extend(reversed(missing))
            if missing:
                continue
            stack.pop()
            if isinstance(last, Expression) and last.operands and last not in seen:
                yield last
                seen.add(last)


def derivatives(results: Sequence[Operand], variable: Expression) -> list[Operand]:
    """Those of results with respect to a given number."""
    slopes: dict[Operand, Operand] = {variable: 1.0}

    def slope(x: Operand) -> Operand:
        return slopes.get(x, 0.0) if isinstance(x, Expression) else 0.0

    for x in in_order(results):
        slopes[x] = RULES[x.operation, len(x.operands)](x, *x.operands, *map(slope, x.operands))
    return [slope(x) for x in results]


# The derivative of a result by its operands and their derivatives.
RULES: dict[tuple[str, int], Callable[..., Operand]] = {
    ("+", 2): lambda y, a, b, da, db: da + db,
    ("-", 2): lambda y, a, b, da, db: da - db,
    ("*", 2): lambda y, a, b, da, db: da * b + a * db,
    ("/", 2): lambda y, a, b, da, db: (da - y * db) / b,
    ("-", 1): lambda y, a, da: -da,
    ("sin", 1): lambda y, a, da: FunctionsOfExpressions.cos(a) * da,
    ("cos", 1): lambda y, a, da: -(FunctionsOfExpressions.sin(a) * da),
}


def _expressions(x: Operand) -> list[Expression]:
    operands = x.operands if isinstance(x, Expression) else ()
    return [item for item in operands if isinstance(item, Expression) and item.operands]


def _operation(name: str, a: Operand, b: Operand) -> Operand:
    """The result of an operation on at least one expression. A product with a known zero is zero."""
    if (a == 0 and name in "*/") or (b == 0 and name == "*"):
        return 0.0
    if (b == 0 and name in "+-") or (b == 1 and name in "*/"):
        return a
    if (a == 0 and name == "+") or (a == 1 and name == "*"):
        return b
    known = a.known if isinstance(a, Expression) else b.known  # pyright: ignore
    return _made(known, name, a, b)


def _made(known: dict[Any, Expression], operation: str, *operands: Operand) -> Expression:
    """The expression, which is made if there is none."""
    keys = [id(x) if isinstance(x, Expression) else ("number", float(x)) for x in operands]
    if operation in COMMUTATIVE:
        keys.sort(key=str)
    return known.setdefault((operation, *keys), Expression(known, operation, operands))
