"""A problem's equations in the languages of the packages that solve them."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..compat import enable_x64
from ..numerics.elements import evaluated, inputs
from ..numerics.expressions import Elementwise, Graph, Node, in_order, is_node
from .problem import Piece, Problem, Rates

# The Python source of the operations in equations and their derivatives.
OPERATIONS = {
    "add": "{} + {}",
    "add_any": "{} + {}",
    "sub": "{} - {}",
    "mul": "{} * {}",
    "div": "{} / {}",
    "neg": "-{}",
    "sin": "sin({})",
    "cos": "cos({})",
}


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
    return _source(f"{name}(t, x, p, rates)", lambda t, x, p: g(t, x, p, jnp), "rates[{}]", states, parameters)


def jacobian_source(g: Rates, states: int, parameters: int, name: str = "jacobian") -> str:
    """A function ``name(t, x, p, jacobian)`` that fills ``jacobian[i, j]`` with ∂g_i/∂x_j, zeros too.

    Its globals must have ``sin`` and ``cos``.
    """

    def rows(t, x, p):
        columns = jax.jacfwd(lambda x: jnp.stack(g(t, x, p, jnp)))(x)
        return jnp.stack(columns, axis=1)

    return _source(f"{name}(t, x, p, jacobian)", rows, "jacobian[{}, {}]", states, parameters)


def _source(signature: str, function: Callable[..., Any], target: str, states: int, parameters: int) -> str:
    """A Python function ``def signature:`` with one assignment per line, of the operations that the results need."""
    number = jax.ShapeDtypeStruct((), np.float64)
    with enable_x64(True):
        program = jax.make_jaxpr(lambda *given: jnp.stack(function(*given)))(
            number, [number] * states, [number] * parameters
        )
        given = [inputs(like) for like in program.in_avals]
        (results,) = evaluated(Graph(), program, given)
    names = ["t", *(f"x[{i}]" for i in range(states)), *(f"p[{i}]" for i in range(parameters))]
    texts = {x.item(): name for x, name in zip(given, names, strict=True)}
    lines = [f"def {signature}:"]
    for k, node in enumerate(in_order(results.reshape(-1), frozenset(texts))):
        lines.append(f"    v{k} = {_operation(node, texts)}")
        texts[node] = f"v{k}"
    lines += [f"    {target.format(*place)} = {_operand(item, texts)}" for place, item in np.ndenumerate(results)]
    return "\n".join([*lines, ""])


def _operation(node: Node, texts: Mapping[Node, str]) -> str:
    assert isinstance(node.operation, Elementwise)
    primitive, params = node.operation
    operands = [_operand(item, texts) for item in node.operands]
    if primitive.name == "integer_pow":
        power = " * ".join(operands * abs(params["y"]))
        return power if params["y"] > 0 else f"1.0 / ({power})"
    return OPERATIONS[primitive.name].format(*operands)


def _operand(item: Any, texts: Mapping[Node, str]) -> str:
    return texts[item] if is_node(item) else f"({item.item()!r})" if item < 0 else repr(item.item())


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
