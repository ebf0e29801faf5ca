"""Forward sensitivities of the paper's ball by CVODES, from CasADi, its functions compiled by gcc."""

from collections.abc import Callable

import casadi
import numpy as np

from .paper_equations import rates
from .paper_numbers import LEGS, ball_numbers, initial_state, parameters, with_parameters

PLACE = -2  # z1 in the state
OPTIONS = {
    "linear_multistep_method": "adams",
    "nonlinear_solver_iteration": "functional",
    "max_num_steps": 100_000,
    "jit": True,
    "compiler": "shell",
    "jit_options": {"compiler": "gcc", "flags": ["-O3", "-march=native"]},
}


def solvers(tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, a function that returns z1(20) and its derivatives."""
    return {tolerance: _solver(tolerance) for tolerance in tolerances}


def _solver(tolerance: float) -> Callable[[], np.ndarray]:
    values = parameters()
    p, x = casadi.MX.sym("p", len(values)), casadi.MX(initial_state(ball_numbers()))
    start = 0.0
    for leg in LEGS:
        x = _leg(leg, start, tolerance)(x0=x, p=p)["xf"]
        start = leg[0]
    each = casadi.MX.eye(len(values))
    derivatives = [casadi.jtimes(x[PLACE], p, each[:, k]) for k in range(len(values))]
    function = casadi.Function("z1", [p], [casadi.vertcat(x[PLACE], *derivatives)])
    return lambda: np.ravel(function(values).full())


def _leg(leg: tuple[float, float, float], start: float, tolerance: float):
    end, constant, slope = leg
    numbers, state = ball_numbers(), initial_state(ball_numbers())
    t, x, p = casadi.SX.sym("t"), casadi.SX.sym("x", len(state)), casadi.SX.sym("p", len(parameters()))
    free = with_parameters(numbers, casadi.vertsplit(p))
    rhs = casadi.vertcat(*rates(free, casadi.vertsplit(x), constant + slope * t, casadi))
    options = OPTIONS | {"reltol": tolerance, "abstol": tolerance}
    return casadi.integrator("leg", "cvodes", {"t": t, "x": x, "p": p, "ode": rhs}, start, end, options)
