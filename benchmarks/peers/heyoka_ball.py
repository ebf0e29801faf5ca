"""The paper's ball in heyoka: Taylor series of an order that suits the tolerance, compiled by LLVM."""

from collections.abc import Callable

import heyoka as hk
import numpy as np

from .paper_equations import rates
from .paper_numbers import LEGS, TOLERANCES, BallNumbers, ball_numbers, initial_state

PACKAGE = "heyoka"
NAMES = ("q0", "q1", "q2", "q3", "O1", "O2", "O3", "z1", "z2")
PROGRAMS = len(TOLERANCES)  # the tolerance decides the order of the series, and so the program


def right_hand_side(numbers: BallNumbers) -> list[tuple]:
    """ẋ as expressions; u(t) is ``par[0] + par[1] t``."""
    n = len(numbers.theta)
    names = [*(f"theta{i}" for i in range(n)), *(f"thetadot{i}" for i in range(n)), *NAMES]
    variables = hk.make_vars(*names)
    u = hk.par[0] + hk.par[1] * hk.time
    return list(zip(variables, rates(numbers, variables, u, hk), strict=True))


def solvers() -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, a function that solves the ball and returns x(20)."""
    hk.llvm_state.set_diskcache_enabled(False)  # so that the build time is one of building
    numbers = ball_numbers()
    equations, x = right_hand_side(numbers), initial_state(numbers)
    return {tolerance: _solver(equations, x, tolerance) for tolerance in TOLERANCES}


def _solver(equations: list[tuple], x: np.ndarray, tolerance: float) -> Callable[[], np.ndarray]:
    integrator = hk.taylor_adaptive(equations, x, tol=tolerance, pars=[0.0, 0.0])

    def solve() -> np.ndarray:
        integrator.time = 0.0
        integrator.state[:] = x
        for end, constant, slope in LEGS:
            integrator.pars[:] = constant, slope
            integrator.propagate_until(end)
        return integrator.state

    return solve
