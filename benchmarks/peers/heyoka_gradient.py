"""The variational equations of the paper's ball in heyoka, for the derivatives of where it comes to."""

from collections.abc import Callable
from typing import Any

import heyoka as hk
import numpy as np
from comparison.problems.rolling import BALL, ball_equations
from comparison.translate import heyoka_system

from . import PLACE, parameters, with_parameters


def solvers(tolerances: tuple[float, ...]) -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, a function that returns z1(20) and its derivatives."""
    hk.llvm_state.set_diskcache_enabled(False)  # so that the build time is one of building
    return {tolerance: _solver(tolerance, np.asarray) for tolerance in tolerances}


def exact(digits: int = 30) -> list[str]:
    """The same to so many digits, as text."""
    bits = int(digits * 3.33) + 20
    found = _solver(hk.real(f"1e-{digits + 3}", bits), lambda x: np.array([hk.real(v, bits) for v in x]))()
    return [str(value) for value in found]


def _solver(tolerance: Any, numbers_as: Callable[[Any], np.ndarray]) -> Callable[[], np.ndarray]:
    values, pushes = parameters(), len(BALL.pieces[0].parameters)
    free = [hk.par[pushes + k] for k in range(len(values))]
    plain = heyoka_system(ball_equations(with_parameters(free)), len(BALL.initial), pushes)
    variational = hk.var_ode_sys(plain, args=free, order=1)
    x, given = numbers_as(BALL.initial), [*numbers_as([0.0] * pushes), *numbers_as(values)]
    integrator = hk.taylor_adaptive(
        variational, x, tol=tolerance, pars=given, fp_type=type(tolerance), compact_mode=True
    )
    start, derivatives = integrator.state.copy(), integrator.get_vslice(order=1, component=len(plain) + PLACE)

    def solve() -> np.ndarray:
        integrator.time = numbers_as([0.0])[0]
        integrator.state[:] = start
        for piece in BALL.pieces:
            integrator.pars[:pushes] = numbers_as(piece.parameters)
            integrator.propagate_until(numbers_as([piece.end])[0])
        return np.append(integrator.state[len(plain) + PLACE], integrator.state[derivatives])

    return solve
