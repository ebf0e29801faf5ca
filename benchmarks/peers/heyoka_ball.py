"""The paper's ball in heyoka: Taylor series of an order that suits the tolerance, compiled by LLVM."""

from collections.abc import Callable

import heyoka as hk
import numpy as np

from .paper_numbers import LEGS, TOLERANCES, BallNumbers, ball_numbers, initial_state

PACKAGE = "heyoka"
PROGRAMS = len(TOLERANCES)  # the tolerance decides the order of the series, and so the program


def cross(a, b):
    """a × b of two triples."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def right_hand_side(numbers: BallNumbers) -> list[tuple]:
    """ẋ of ``rolling_ball_ode_f`` as expressions; u(t) is ``par[0] + par[1] t``."""
    n = len(numbers.theta)
    theta = hk.make_vars(*(f"theta{i}" for i in range(n)))
    thetadot = hk.make_vars(*(f"thetadot{i}" for i in range(n)))
    q0, q1, q2, q3 = q = hk.make_vars("q0", "q1", "q2", "q3")
    O = hk.make_vars("O1", "O2", "O3")
    z = hk.make_vars("z1", "z2")
    u = hk.par[0] + hk.par[1] * hk.time
    r, d = numbers.r, numbers.d
    Gamma = [2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1**2 + q2**2)]
    kappa = acceleration(numbers, theta, thetadot, u, O, Gamma, d)
    omega1 = (1 - 2 * (q2**2 + q3**2)) * O[0] + 2 * (q1 * q2 - q0 * q3) * O[1] + 2 * (q1 * q3 + q0 * q2) * O[2]
    omega2 = 2 * (q1 * q2 + q0 * q3) * O[0] + (1 - 2 * (q1**2 + q3**2)) * O[1] + 2 * (q2 * q3 - q0 * q1) * O[2]
    qdot = [
        -0.5 * (q1 * O[0] + q2 * O[1] + q3 * O[2]),
        0.5 * (q0 * O[0] + q2 * O[2] - q3 * O[1]),
        0.5 * (q0 * O[1] + q3 * O[0] - q1 * O[2]),
        0.5 * (q0 * O[2] + q1 * O[1] - q2 * O[0]),
    ]
    variables = [*theta, *thetadot, *q, *O, *z]
    return list(zip(variables, [*thetadot, *[u] * n, *qdot, *kappa, r * omega2, -r * omega1], strict=True))


def acceleration(numbers: BallNumbers, theta, thetadot, u, O, Gamma, d) -> list:
    """κ of ``eq_ball_kappa``, its sums over masses one by one."""
    A = [[d[0], 0.0, 0.0], [0.0, d[1], 0.0], [0.0, 0.0, d[2]]]
    b = cross(O, [d[k] * O[k] for k in range(3)])
    for m, zeta, velocity, pull in kinematics(numbers, theta, thetadot, u):
        s = [numbers.r * Gamma[k] + zeta[k] for k in range(3)]
        w = cross(O, zeta)
        turned = cross(O, [w[k] + 2 * velocity[k] for k in range(3)])
        torque = cross(s, [numbers.g * Gamma[k] + turned[k] + pull[k] for k in range(3)])
        square = s[0] ** 2 + s[1] ** 2 + s[2] ** 2
        b = [b[k] + m * torque[k] for k in range(3)]
        A = [[A[i][j] + m * ((square if i == j else 0.0) - s[i] * s[j]) for j in range(3)] for i in range(3)]
    c0, c1, c2 = cross(A[1], A[2]), cross(A[2], A[0]), cross(A[0], A[1])
    determinant = A[0][0] * c0[0] + A[0][1] * c0[1] + A[0][2] * c0[2]
    return [-(c0[k] * b[0] + c1[k] * b[1] + c2[k] * b[2]) / determinant for k in range(3)]


def kinematics(numbers: BallNumbers, theta, thetadot, u):
    """m_i, ζ_i, θ̇_i ζ_i′ and θ̇_i² ζ_i″ + u ζ_i′ of the shell and of every mass."""
    yield numbers.m[0], list(numbers.zeta0), [0.0] * 3, [0.0] * 3
    for m, U, V, angle, rate in zip(numbers.m[1:], numbers.u, numbers.v, theta, thetadot, strict=True):
        c, s = hk.cos(angle), hk.sin(angle)
        zeta = [U[k] * c + V[k] * s for k in range(3)]
        slope = [V[k] * c - U[k] * s for k in range(3)]
        yield (
            m,
            zeta,
            [rate * slope[k] for k in range(3)],
            [u * slope[k] - rate**2 * zeta[k] for k in range(3)],
        )


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
