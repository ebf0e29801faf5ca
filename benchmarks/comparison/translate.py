"""A problem's equations in the languages of the packages that solve them."""

import importlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import jax.numpy as jnp
from jaxtyping import Array, Float

from .problem import Piece, Problem, Rates

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
        return _make(self.known, "-", self)


class FunctionsOfExpressions:
    """The functions that equations may call, of expressions and of known numbers."""

    @staticmethod
    def sin(x: Operand) -> Operand:
        """The sine."""
        return _make(x.known, "sin", x) if isinstance(x, Expression) else math.sin(x)

    @staticmethod
    def cos(x: Operand) -> Operand:
        """The cosine."""
        return _make(x.known, "cos", x) if isinstance(x, Expression) else math.cos(x)


def make_numbers(names: Sequence[str]) -> list[Expression]:
    """Makes the numbers with these names, of one program."""
    known: dict[Any, Expression] = {}
    return [_make(known, name) for name in names]


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
    return _make(known, name, a, b)


def _make(known: dict[Any, Expression], operation: str, *operands: Operand) -> Expression:
    """Makes the expression if there is none yet."""
    keys = [id(x) if isinstance(x, Expression) else ("number", float(x)) for x in operands]
    if operation in COMMUTATIVE:
        keys.sort(key=str)
    return known.setdefault((operation, *keys), Expression(known, operation, operands))


def jax_field(g: Rates) -> Callable[[Float[Array, ""], Float[Array, " state"], Any], Float[Array, " state"]]:
    """g as a vector field f(t, x, args) for diffrax; ``args`` is the array of the piece's parameters."""

    def field(t: Float[Array, ""], x: Float[Array, " state"], args: Float[Array, " parameters"]):
        return jnp.stack(g(t, list(x), list(args), jnp))

    return field


def jax_parameters(problem: Problem) -> Callable[[Float[Array, ""]], Float[Array, " parameters"]]:
    """The parameters at time t, those of the later piece at a kink: for a field on the whole interval."""

    def parameters(t: Float[Array, ""]) -> Float[Array, " parameters"]:
        first, *rest = problem.pieces
        chosen = jnp.asarray(first.parameters, dtype=t.dtype)
        for piece in rest:
            chosen = jnp.where(t >= piece.start, jnp.asarray(piece.parameters, dtype=t.dtype), chosen)
        return chosen

    return parameters


def python_source(g: Rates, states: int, parameters: int) -> str:
    """A function ``rates(t, x, p, rates)`` that fills the array ``rates``, one operation per line, for a compiler.

    Its globals must have ``sin`` and ``cos``.
    """
    t, x, p = _make_arguments(states, parameters)
    targets = {f"rates[{i}]": rate for i, rate in enumerate(g(t, x, p, FunctionsOfExpressions))}
    return _source("rates(t, x, p, rates)", targets)


def jacobian_source(g: Rates, states: int, parameters: int) -> str:
    """A function ``jacobian(t, x, p, jacobian)`` that fills ``jacobian[i, j]`` with ∂g_i/∂x_j, zeros too.

    Its globals must have ``sin`` and ``cos``.
    """
    t, x, p = _make_arguments(states, parameters)
    rates = g(t, x, p, FunctionsOfExpressions)
    columns = [derivatives(rates, variable) for variable in x]
    targets = {f"jacobian[{i}, {j}]": columns[j][i] for i in range(len(rates)) for j in range(states)}
    return _source("jacobian(t, x, p, jacobian)", targets)


def _make_arguments(states: int, parameters: int) -> tuple[Expression, list[Expression], list[Expression]]:
    names = [f"x[{i}]" for i in range(states)], [f"p[{i}]" for i in range(parameters)]
    t, *others = make_numbers(["t", *names[0], *names[1]])
    return t, others[:states], others[states:]


def _source(signature: str, targets: Mapping[str, Operand]) -> str:
    """A Python function ``def signature:`` that fills targets, one operation per line, of those that they need."""
    texts: dict[Expression, str] = {}
    lines = [f"def {signature}:"]

    def text(x: Operand) -> str:
        if isinstance(x, Expression):
            return texts.get(x, x.operation)
        return f"({float(x)!r})" if x < 0 else repr(float(x))

    for k, x in enumerate(in_order(list(targets.values()))):
        operands = [text(item) for item in x.operands]
        whole = f" {x.operation} ".join(operands) if len(operands) > 1 else f"{x.operation}({operands[0]})"
        lines.append(f"    v{k} = {whole}")
        texts[x] = f"v{k}"
    return "\n".join([*lines, *(f"    {target} = {text(x)}" for target, x in targets.items()), ""])


def casadi_dae(problem: Problem, piece: Piece) -> dict[str, Any]:
    """The problem on ``piece`` as ``casadi.integrator`` takes it: x, ode and, of a DAE, z, the component that is
    algebraic, and alg, the constraint.

    **Raises:** ``ImportError`` if CasADi is not installed.
    """
    casadi: Any = importlib.import_module("casadi")

    t, x = casadi.SX.sym("t"), casadi.SX.sym("x", len(problem.initial))
    p = casadi.SX.sym("p", len(piece.parameters))
    xs = casadi.vertsplit(x)
    rates = problem.right_hand_side(piece)(t, xs, casadi.vertsplit(p), casadi)
    k = piece.algebraic
    if k is None:
        return {"t": t, "x": x, "p": p, "ode": casadi.vertcat(*rates)}
    return {
        "t": t,
        "x": casadi.vertcat(*xs[:k], *xs[k + 1 :]),
        "z": xs[k],
        "p": p,
        "ode": casadi.vertcat(*rates[:k], *rates[k + 1 :]),
        "alg": rates[k],
    }


def heyoka_system(g: Rates, states: int, parameters: int) -> list[tuple[Any, Any]]:
    """g as heyoka's pairs of a variable and its rate; the parameters are ``heyoka.par[i]``.

    **Raises:** ``ImportError`` if heyoka is not installed.
    """
    heyoka: Any = importlib.import_module("heyoka")

    x = [heyoka.expression(f"x{i}") for i in range(states)]
    rates = g(heyoka.time, x, [heyoka.par[i] for i in range(parameters)], heyoka)
    return list(zip(x, rates, strict=True))
