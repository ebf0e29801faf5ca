"""The paper's equations of its ball, with the sums over masses written out, in scalars of any package."""

from typing import Any

from .paper_numbers import BallNumbers


def rates(numbers: BallNumbers, x: list, u: Any, functions: Any) -> list:
    """ẋ of ``rolling_ball_ode_f`` for x = (θ, θ̇, q, Ω, z); ``functions`` has ``cos`` and ``sin``."""
    n = len(numbers.theta)
    theta, thetadot, (q0, q1, q2, q3), O = x[:n], x[n : 2 * n], x[2 * n : 2 * n + 4], x[2 * n + 4 : 2 * n + 7]
    Gamma = [2 * (q1 * q3 - q0 * q2), 2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1**2 + q2**2)]
    kappa = acceleration(numbers, theta, thetadot, u, O, Gamma, functions)
    omega1 = (1 - 2 * (q2**2 + q3**2)) * O[0] + 2 * (q1 * q2 - q0 * q3) * O[1] + 2 * (q1 * q3 + q0 * q2) * O[2]
    omega2 = 2 * (q1 * q2 + q0 * q3) * O[0] + (1 - 2 * (q1**2 + q3**2)) * O[1] + 2 * (q2 * q3 - q0 * q1) * O[2]
    qdot = [
        -0.5 * (q1 * O[0] + q2 * O[1] + q3 * O[2]),
        0.5 * (q0 * O[0] + q2 * O[2] - q3 * O[1]),
        0.5 * (q0 * O[1] + q3 * O[0] - q1 * O[2]),
        0.5 * (q0 * O[2] + q1 * O[1] - q2 * O[0]),
    ]
    return [*thetadot, *[u] * n, *qdot, *kappa, numbers.r * omega2, -numbers.r * omega1]


def acceleration(numbers: BallNumbers, theta, thetadot, u, O, Gamma, functions) -> list:
    """κ of ``eq_ball_kappa``, its sums over masses one by one."""
    d = numbers.d
    A = [[d[0], 0.0, 0.0], [0.0, d[1], 0.0], [0.0, 0.0, d[2]]]
    b = cross(O, [d[k] * O[k] for k in range(3)])
    for m, zeta, velocity, pull in kinematics(numbers, theta, thetadot, u, functions):
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


def kinematics(numbers: BallNumbers, theta, thetadot, u, functions):
    """m_i, ζ_i, θ̇_i ζ_i′ and θ̇_i² ζ_i″ + u ζ_i′ of the shell and of every mass."""
    yield numbers.m[0], list(numbers.zeta0), [0.0] * 3, [0.0] * 3
    for m, U, V, angle, rate in zip(numbers.m[1:], numbers.u, numbers.v, theta, thetadot, strict=True):
        c, s = functions.cos(angle), functions.sin(angle)
        zeta = [U[k] * c + V[k] * s for k in range(3)]
        slope = [V[k] * c - U[k] * s for k in range(3)]
        yield (
            m,
            zeta,
            [rate * slope[k] for k in range(3)],
            [u * slope[k] - rate**2 * zeta[k] for k in range(3)],
        )


def cross(a, b):
    """a × b of two triples."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
