"""Collocation at the Radau points in many digits: the truth about stiff problems, in mpmath, slowly.

Radau IIA of s stages, order 2s − 1 (Hairer & Wanner II, section IV.5). The nonlinear equations are held to many
digits; only their corrections come from a float64 Newton matrix, which changes how fast they converge and not where to.
"""

import mpmath as mp
import numpy as np


def radau_points(s):
    """The points 0 < c_1 < … < c_s = 1: zeros of P_s − P_{s−1}, the Legendre polynomials moved to [0, 1]."""
    guesses = np.sort(np.polynomial.Legendre([0.0] * (s - 1) + [-1.0, 1.0]).roots())[:-1]
    return [mp.findroot(lambda c: mp.legendre(s, 2 * c - 1) - mp.legendre(s - 1, 2 * c - 1), (x + 1) / 2) for x in guesses] + [
        mp.mpf(1)
    ]


def collocation_matrix(c):
    """A_ij = ∫_0^{c_i} of the Lagrange polynomial that is one at c_j, and the weights of the derivative of order s − 1."""
    s = len(c)
    powers = mp.matrix(s, s)
    integrals = mp.matrix(s, s)
    for i in range(s):
        for k in range(s):
            powers[i, k], integrals[i, k] = c[i] ** k, c[i] ** (k + 1) / (k + 1)
    inverse = powers**-1
    return integrals * inverse, [inverse[s - 1, j] / mp.binomial(2 * s - 2, s - 1) for j in range(s)]


def solve(f, jacobian, x, start, end, tolerance, stages=9, digits=32):
    """x at ``end`` of ẋ = ``f(x)`` from ``x`` at ``start``, and the number of steps.

    ``tolerance`` bounds, relative to each component, the last Legendre coefficient of ẋ times the step, which is
    of order s and so far above the error.
    """
    with mp.workdps(digits):
        c = radau_points(stages)
        A, tail = collocation_matrix(c)
        A_float = np.array(A.tolist(), dtype=float)
        t, end, x, steps = mp.mpf(start), mp.mpf(end), [mp.mpf(v) for v in x], 0
        h, largest = mp.mpf("1e-8"), [abs(v) for v in x]
        while t < end:
            h = min(h, end - t)
            Z, rates = _stages(f, jacobian, x, h, A, A_float, digits)
            if Z is None:
                h /= 4
                continue
            error = max(
                float(h * abs(sum(w * rate[k] for w, rate in zip(tail, rates, strict=True))) / (abs(x[k]) + abs(Z[-1][k]) + mp.mpf("1e-30")))
                for k in range(len(x))
            )
            factor = min(4.0, max(0.1, 0.8 * (tolerance / max(error, 1e-300)) ** (1 / stages)))
            if error <= tolerance:
                t, x, steps = t + h, [v + dv for v, dv in zip(x, Z[-1], strict=True)], steps + 1
            h *= factor
        return x, steps


def _stages(f, jacobian, x, h, A, A_float, digits):
    s, n = len(A_float), len(x)
    J = np.array(jacobian([float(v) for v in x]))
    inverse = np.linalg.inv(np.eye(s * n) - float(h) * np.kron(A_float, J))
    Z, last = [[mp.mpf(0)] * n for _ in range(s)], None
    for _ in range(60):
        rates = [f([v + dv for v, dv in zip(x, z, strict=True)]) for z in Z]
        residual = [[Z[i][k] - h * mp.fdot((A[i, j], rates[j][k]) for j in range(s)) for k in range(n)] for i in range(s)]
        correction = inverse @ np.array([[float(v) for v in row] for row in residual]).ravel()
        size = max(abs(correction.reshape(s, n)) .max(0) / [float(abs(v)) + 1e-30 for v in x])
        if last is not None and not size < 0.7 * last:
            return None, None
        Z = [[Z[i][k] - mp.mpf(correction[i * n + k]) for k in range(n)] for i in range(s)]
        if size < 10.0 ** (6 - digits):
            return Z, rates
        last = size
    return None, None
