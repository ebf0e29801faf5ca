"""The paper's ball in numbalsoda: Hairer's DOP853 in Fortran around a right-hand side compiled by Numba."""

from collections.abc import Callable

import numpy as np
from numba import carray, cfunc, njit
from numbalsoda import dop853, lsoda_sig

from .paper_numbers import LEGS, TOLERANCES, ball_numbers, initial_state

PACKAGE = "numbalsoda"
PROGRAMS = 1  # the tolerance is an argument
NUMBERS = ball_numbers()
M, D, R, G, ZETA0, U, V, _ = NUMBERS
D1, D2, D3 = D
N = len(U)
STATE = 2 * N + 9
ENDS = np.array([leg[0] for leg in LEGS])
CONSTANTS = np.array([leg[1] for leg in LEGS])
SLOPES = np.array([leg[2] for leg in LEGS])


@njit(inline="always")
def cross(a, b):
    """a × b of two triples."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(inline="always")
def add_mass(A, b, m, zeta, velocity, acceleration, O, Gamma):
    """Adds one mass's part to the matrix (as six numbers) and the vector of ``eq_ball_kappa``."""
    s = (R * Gamma[0] + zeta[0], R * Gamma[1] + zeta[1], R * Gamma[2] + zeta[2])
    w = cross(O, zeta)
    k = cross(O, (w[0] + 2 * velocity[0], w[1] + 2 * velocity[1], w[2] + 2 * velocity[2]))
    force = (
        G * Gamma[0] + k[0] + acceleration[0],
        G * Gamma[1] + k[1] + acceleration[1],
        G * Gamma[2] + k[2] + acceleration[2],
    )
    torque = cross(s, force)
    A = (
        A[0] + m * (s[1] * s[1] + s[2] * s[2]),
        A[1] + m * (s[0] * s[0] + s[2] * s[2]),
        A[2] + m * (s[0] * s[0] + s[1] * s[1]),
        A[3] - m * s[0] * s[1],
        A[4] - m * s[0] * s[2],
        A[5] - m * s[1] * s[2],
    )
    return A, (b[0] + m * torque[0], b[1] + m * torque[1], b[2] + m * torque[2])


@njit(inline="always")
def solve_symmetric(A, b):
    """x of A x = b for the symmetric matrix with diagonal A[:3] and A12, A13, A23 in A[3:]."""
    c11, c12, c13 = A[1] * A[2] - A[5] * A[5], A[4] * A[5] - A[3] * A[2], A[3] * A[5] - A[4] * A[1]
    c22, c23, c33 = A[0] * A[2] - A[4] * A[4], A[3] * A[4] - A[0] * A[5], A[0] * A[1] - A[3] * A[3]
    scale = 1 / (A[0] * c11 + A[3] * c12 + A[4] * c13)
    return (
        scale * (c11 * b[0] + c12 * b[1] + c13 * b[2]),
        scale * (c12 * b[0] + c22 * b[1] + c23 * b[2]),
        scale * (c13 * b[0] + c23 * b[1] + c33 * b[2]),
    )


@cfunc(lsoda_sig)
def right_hand_side(t, x_pointer, rate_pointer, leg_pointer):
    """f of ``rolling_ball_ode_f``, its sums over masses one by one; u(t) is ``leg[0] + leg[1] t``."""
    x, rate, leg = carray(x_pointer, STATE), carray(rate_pointer, STATE), carray(leg_pointer, 2)
    u = leg[0] + leg[1] * t
    q0, q1, q2, q3 = x[2 * N], x[2 * N + 1], x[2 * N + 2], x[2 * N + 3]
    O = (x[2 * N + 4], x[2 * N + 5], x[2 * N + 6])
    Gamma = (2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1 * q1 + q2 * q2))
    A = (D1, D2, D3, 0.0, 0.0, 0.0)
    b = cross(O, (D1 * O[0], D2 * O[1], D3 * O[2]))
    zero = (0.0, 0.0, 0.0)
    A, b = add_mass(A, b, M[0], (ZETA0[0], ZETA0[1], ZETA0[2]), zero, zero, O, Gamma)
    for i in range(N):
        c, s, w = np.cos(x[i]), np.sin(x[i]), x[N + i]
        zeta = (U[i, 0] * c + V[i, 0] * s, U[i, 1] * c + V[i, 1] * s, U[i, 2] * c + V[i, 2] * s)
        slope = (V[i, 0] * c - U[i, 0] * s, V[i, 1] * c - U[i, 1] * s, V[i, 2] * c - U[i, 2] * s)
        velocity = (w * slope[0], w * slope[1], w * slope[2])
        acceleration = (
            u * slope[0] - w * w * zeta[0],
            u * slope[1] - w * w * zeta[1],
            u * slope[2] - w * w * zeta[2],
        )
        A, b = add_mass(A, b, M[i + 1], zeta, velocity, acceleration, O, Gamma)
        rate[i], rate[N + i] = w, u
    kappa = solve_symmetric(A, b)
    rate[2 * N] = -0.5 * (q1 * O[0] + q2 * O[1] + q3 * O[2])
    rate[2 * N + 1] = 0.5 * (q0 * O[0] + q2 * O[2] - q3 * O[1])
    rate[2 * N + 2] = 0.5 * (q0 * O[1] + q3 * O[0] - q1 * O[2])
    rate[2 * N + 3] = 0.5 * (q0 * O[2] + q1 * O[1] - q2 * O[0])
    rate[2 * N + 4], rate[2 * N + 5], rate[2 * N + 6] = -kappa[0], -kappa[1], -kappa[2]
    omega1 = (1 - 2 * (q2 * q2 + q3 * q3)) * O[0] + 2 * (q1 * q2 - q0 * q3) * O[1] + 2 * (q1 * q3 + q0 * q2) * O[2]
    omega2 = 2 * (q1 * q2 + q0 * q3) * O[0] + (1 - 2 * (q1 * q1 + q3 * q3)) * O[1] + 2 * (q2 * q3 - q0 * q1) * O[2]
    rate[2 * N + 7], rate[2 * N + 8] = R * omega2, -R * omega1


ADDRESS = right_hand_side.address


@njit
def run(x, tolerance):
    """x(20), leg by leg between the kinks."""
    start = 0.0
    for k in range(len(ENDS)):
        leg = np.array([CONSTANTS[k], SLOPES[k]])
        states, _ = dop853(ADDRESS, x, np.array([start, ENDS[k]]), leg, rtol=tolerance, atol=tolerance)
        x, start = states[1], ENDS[k]
    return x


def solvers() -> dict[float, Callable[[], np.ndarray]]:
    """For each tolerance, a function that solves the ball and returns x(20)."""
    x = initial_state(NUMBERS)
    run(x, 1e-6)
    return {tolerance: lambda tolerance=tolerance: run(x, tolerance) for tolerance in TOLERANCES}
