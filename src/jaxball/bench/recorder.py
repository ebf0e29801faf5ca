"""Equations in scalars as a list of single operations, each recorded once however often it occurs."""

import operator
from collections.abc import Callable, Sequence

from .problem import Rates, Scalar

Operand = str | float  # the name of a variable, or a constant

BINARY: dict[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}


class Recorded:
    """A scalar that writes down what is done with it."""

    __slots__ = ("operand", "recorder")

    def __init__(self, recorder: "Recorder", operand: Operand):
        self.recorder, self.operand = recorder, operand

    def __add__(self, other: Scalar) -> "Recorded":
        return self.recorder.binary("+", self, other)

    def __radd__(self, other: Scalar) -> "Recorded":
        return self.recorder.binary("+", other, self)

    def __sub__(self, other: Scalar) -> "Recorded":
        return self.recorder.binary("-", self, other)

    def __rsub__(self, other: Scalar) -> "Recorded":
        return self.recorder.binary("-", other, self)

    def __mul__(self, other: Scalar) -> "Recorded":
        return self.recorder.binary("*", self, other)

    def __rmul__(self, other: Scalar) -> "Recorded":
        return self.recorder.binary("*", other, self)

    def __truediv__(self, other: Scalar) -> "Recorded":
        return self.recorder.binary("/", self, other)

    def __rtruediv__(self, other: Scalar) -> "Recorded":
        return self.recorder.binary("/", other, self)

    def __neg__(self) -> "Recorded":
        return self.recorder.binary("-", 0.0, self)


class Recorder:
    """The operations so far, in order; also the ``functions`` of the equations that are recorded."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, ...] | tuple[str, Operand, Operand], str] = {}

    @property
    def lines(self) -> list[tuple[str, tuple]]:
        """Each variable's name and its operation: an operator or a function, and operands."""
        return [(name, operation) for operation, name in self._names.items()]

    def variable(self, name: str) -> Recorded:
        """A scalar that is there from the start."""
        return Recorded(self, name)

    def sin(self, a: Scalar) -> Recorded:
        return self._record("sin", self._operand(a))

    def cos(self, a: Scalar) -> Recorded:
        return self._record("cos", self._operand(a))

    def binary(self, symbol: str, a: Scalar, b: Scalar) -> Recorded:
        """a + b, a − b, a × b or a / b, where nothing is recorded for constants, a zero or a one."""
        a, b = self._operand(a), self._operand(b)
        if isinstance(a, float) and isinstance(b, float):
            return Recorded(self, BINARY[symbol](a, b))
        if symbol == "*" and 0.0 in (a, b):
            return Recorded(self, 0.0)
        if (symbol in "+-" and b == 0.0) or (symbol in "*/" and b == 1.0):
            return Recorded(self, a)
        if (symbol == "+" and a == 0.0) or (symbol == "*" and a == 1.0):
            return Recorded(self, b)
        if symbol in "+*":
            a, b = sorted((a, b), key=str)
        return self._record(symbol, a, b)

    def _record(self, *operation) -> Recorded:
        return Recorded(self, self._names.setdefault(operation, f"v{len(self._names)}"))

    def _operand(self, a: Scalar) -> Operand:
        return a.operand if isinstance(a, Recorded) else float(a)


def record(g: Rates, states: int, parameters: int) -> tuple[Recorder, list[Scalar]]:
    """``g(t, x, p)`` recorded with the variables ``t``, ``x[i]``, ``p[i]``: the recorder, and the rates in it."""
    recorder = Recorder()
    x = [recorder.variable(f"x[{i}]") for i in range(states)]
    p = [recorder.variable(f"p[{i}]") for i in range(parameters)]
    return recorder, g(recorder.variable("t"), x, p, recorder)


def jacobian(recorder: Recorder, results: Sequence[Scalar], variables: Sequence[str]) -> list[list[Scalar]]:
    """The derivatives of each of ``results``, a row, by each of ``variables``, recorded behind them by forward mode."""
    lines = recorder.lines
    columns = [_column(recorder, lines, results, variable) for variable in variables]
    return [list(row) for row in zip(*columns, strict=True)]


def _column(
    recorder: Recorder, lines: Sequence[tuple[str, tuple]], results: Sequence[Scalar], variable: str
) -> list[Scalar]:
    rates: dict[Operand, Scalar] = {variable: 1.0}
    for name, (symbol, *operands) in lines:
        if any(operand in rates for operand in operands):
            given = [rates.get(operand, 0.0) for operand in operands]
            values = [recorder.variable(a) if isinstance(a, str) else a for a in operands]
            rates[name] = _rate(recorder, symbol, recorder.variable(name), values, given)
    return [rates.get(result.operand, 0.0) if isinstance(result, Recorded) else 0.0 for result in results]


def _rate(recorder: Recorder, symbol: str, value: Recorded, a: Sequence[Scalar], da: Sequence[Scalar]) -> Scalar:
    match symbol:
        case "+":
            return da[0] + da[1]
        case "-":
            return da[0] - da[1]
        case "*":
            return da[0] * a[1] + a[0] * da[1]
        case "/":
            return (da[0] - value * da[1]) / a[1]
        case "sin":
            return recorder.cos(a[0]) * da[0]
        case _:  # cos
            return -recorder.sin(a[0]) * da[0]


def source(signature: str, recorder: Recorder, targets: dict[str, Scalar]) -> str:
    """A Python function ``def signature:`` of one assignment a line that fills ``targets``.

    Operations that no target needs are left out. It calls ``sin`` and ``cos``, which its globals must have.
    """
    ends = {target: value.operand if isinstance(value, Recorded) else float(value) for target, value in targets.items()}
    needed, kept = set(ends.values()), []
    for name, (symbol, *operands) in reversed(recorder.lines):
        if name in needed:
            needed.update(operands)
            texts = [_text(operand) for operand in operands]
            text = f" {symbol} ".join(texts) if symbol in BINARY else f"{symbol}({texts[0]})"
            kept.append(f"    {name} = {text}")
    body = [*reversed(kept), *(f"    {target} = {_text(end)}" for target, end in ends.items())]
    return "\n".join([f"def {signature}:", *body, ""])


def _text(operand: Operand) -> str:
    return operand if isinstance(operand, str) else f"({operand!r})" if operand < 0 else repr(operand)
