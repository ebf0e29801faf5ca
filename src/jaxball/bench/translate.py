"""A problem's equations in the languages of the packages that solve them."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from .expressions import Expression, FunctionsOfExpressions, Operand, derivatives, given, in_order
from .problem import Piece, Problem, Rates


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


def python_source(g: Rates, states: int, parameters: int, name: str = "rates") -> str:
    """A function ``name(t, x, p, rates)`` that fills the array ``rates``, one operation per line, for a compiler.

    Its globals must have ``sin`` and ``cos``.
    """
    t, x, p = _given(states, parameters)
    targets = {f"rates[{i}]": rate for i, rate in enumerate(g(t, x, p, FunctionsOfExpressions))}
    return _source(f"{name}(t, x, p, rates)", targets)


def jacobian_source(g: Rates, states: int, parameters: int, name: str = "jacobian") -> str:
    """A function ``name(t, x, p, jacobian)`` that fills ``jacobian[i, j]`` with ∂g_i/∂x_j, zeros too.

    Its globals must have ``sin`` and ``cos``.
    """
    t, x, p = _given(states, parameters)
    rates = g(t, x, p, FunctionsOfExpressions)
    columns = [derivatives(rates, variable) for variable in x]
    targets = {f"jacobian[{i}, {j}]": columns[j][i] for i in range(len(rates)) for j in range(states)}
    return _source(f"{name}(t, x, p, jacobian)", targets)


def _given(states: int, parameters: int) -> tuple[Expression, list[Expression], list[Expression]]:
    names = [f"x[{i}]" for i in range(states)], [f"p[{i}]" for i in range(parameters)]
    t, *others = given(["t", *names[0], *names[1]])
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
