"""Forward sensitivities of the paper's ball by CVODES, from CasADi, its functions compiled by gcc."""

from collections.abc import Callable

import casadi
import numpy as np
from comparison.contenders.casadi_ import METHODS, compiling
from comparison.problem import Piece
from comparison.problems.rolling import BALL, ball_equations

from . import PLACE, parameters, with_parameters

CVODES, OPTIONS = METHODS["CVODES Adams"]


def solvers(tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, a function that returns z1(20) and its derivatives."""
    return {tolerance: _solver(tolerance) for tolerance in tolerances}


def _solver(tolerance: float) -> Callable[[], np.ndarray]:
    values = parameters()
    p, x = casadi.MX.sym("p", len(values)), casadi.MX(BALL.initial)
    with compiling() as compiled:
        options = OPTIONS | compiled | {"reltol": tolerance, "abstol": tolerance, "max_num_steps": 100_000}
        for piece in BALL.pieces:
            leg = casadi.integrator("leg", CVODES, _equations(piece), piece.start, piece.end, options)
            x = leg(x0=x, p=p)["xf"]
        each = casadi.MX.eye(len(values))
        derivatives = [casadi.jtimes(x[PLACE], p, each[:, k]) for k in range(len(values))]
        function = casadi.Function("z1", [p], [casadi.vertcat(x[PLACE], *derivatives)])
    return lambda: np.ravel(function(values).full())


def _equations(piece: Piece) -> dict[str, casadi.SX]:
    t, x, p = casadi.SX.sym("t"), casadi.SX.sym("x", len(BALL.initial)), casadi.SX.sym("p", len(parameters()))
    rates = ball_equations(with_parameters(casadi.vertsplit(p)))
    return {"t": t, "x": x, "p": p, "ode": casadi.vertcat(*rates(t, casadi.vertsplit(x), piece.parameters, casadi))}
