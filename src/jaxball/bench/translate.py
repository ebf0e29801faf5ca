"""A problem's equations in the languages of the packages that solve them."""

import importlib
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from .problem import Piece, Problem, Rates
from .recorder import jacobian, record, source


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
    """A function ``name(t, x, p, rates)`` that fills the array ``rates``, one operation a line, for a compiler.

    Its globals must have ``sin`` and ``cos``.
    """
    recorder, results = record(g, states, parameters)
    return source(f"{name}(t, x, p, rates)", recorder, {f"rates[{i}]": rate for i, rate in enumerate(results)})


def jacobian_source(g: Rates, states: int, parameters: int, name: str = "jacobian") -> str:
    """A function ``name(t, x, p, jacobian)`` that fills ``jacobian[i, j]`` with ∂g_i/∂x_j, zeros too.

    Its globals must have ``sin`` and ``cos``.
    """
    recorder, results = record(g, states, parameters)
    rows = jacobian(recorder, results, [f"x[{j}]" for j in range(states)])
    targets = {f"jacobian[{i}, {j}]": entry for i, row in enumerate(rows) for j, entry in enumerate(row)}
    return source(f"{name}(t, x, p, jacobian)", recorder, targets)


def casadi_function(g: Rates, states: int, parameters: int) -> Any:
    """g as a CasADi function (t, x, p) → g.

    **Raises:** ``ImportError`` where CasADi is not installed.
    """
    casadi: Any = importlib.import_module("casadi")

    t, x, p = casadi.SX.sym("t"), casadi.SX.sym("x", states), casadi.SX.sym("p", parameters)
    rates = g(t, casadi.vertsplit(x), casadi.vertsplit(p), casadi)
    return casadi.Function("g", [t, x, p], [casadi.vertcat(*rates)], ["t", "x", "p"], ["rates"])


def casadi_dae(problem: Problem, piece: Piece) -> dict[str, Any]:
    """The problem on ``piece`` as ``casadi.integrator`` takes it: x, ode and, of a DAE, z, the component that is
    algebraic, and alg, the constraint.

    **Raises:** ``ImportError`` where CasADi is not installed.
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

    **Raises:** ``ImportError`` where heyoka is not installed.
    """
    heyoka: Any = importlib.import_module("heyoka")

    x = [heyoka.expression(f"x{i}") for i in range(states)]
    rates = g(heyoka.time, x, [heyoka.par[i] for i in range(parameters)], heyoka)
    return list(zip(x, rates, strict=True))
