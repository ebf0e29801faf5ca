"""The variational equations of the paper's ball in heyoka, for the derivatives of where it comes to."""

from collections.abc import Callable
from typing import Any

import heyoka as hk
import numpy as np

from .heyoka_ball import right_hand_side
from .paper_numbers import LEGS, ball_numbers, initial_state, parameters, with_parameters

PLACE = -2  # z1 in the state


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
    numbers, values = ball_numbers(), parameters()
    free = [hk.par[2 + k] for k in range(len(values))]
    plain = right_hand_side(with_parameters(numbers, free))
    x, nothing = numbers_as(initial_state(numbers)), numbers_as([0.0, 0.0])
    variational = hk.var_ode_sys(plain, args=free, order=1)
    kind = type(tolerance)
    integrator = hk.taylor_adaptive(
        variational, x, tol=tolerance, pars=[*nothing, *numbers_as(values)], fp_type=kind, compact_mode=True
    )
    start, derivatives = integrator.state.copy(), integrator.get_vslice(order=1, component=len(plain) + PLACE)

    def solve() -> np.ndarray:
        integrator.time = numbers_as([0.0])[0]
        integrator.state[:] = start
        for end, constant, slope in LEGS:
            integrator.pars[:2] = numbers_as([constant, slope])
            integrator.propagate_until(numbers_as([end])[0])
        return np.append(integrator.state[len(plain) + PLACE], integrator.state[derivatives])

    return solve
