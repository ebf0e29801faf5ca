"""Collocation at the Radau points in many digits: the truth about stiff problems, in mpmath, in seconds.

Radau IIA with s stages has order 2s − 1 (Hairer & Wanner II, section IV.5). Its nonlinear equations are solved to
many digits; only the Newton matrix is float64, which changes how fast the iteration converges and not where to.
"""

import mpmath as mp
import numpy as np

MANY_ITERATIONS = 60


def radau_points(s):
    """The points 0 < c_1 < … < c_s = 1: zeros of P_s − P_{s−1}, the Legendre polynomials moved to [0, 1]."""

    def difference(c):
        return mp.legendre(s, 2 * c - 1) - mp.legendre(s - 1, 2 * c - 1)

    guesses = np.sort(np.polynomial.Legendre([0.0] * (s - 1) + [-1.0, 1.0]).roots().real)[:-1]  # complex from NumPy 2.5
    return [*(mp.findroot(difference, (x + 1) / 2) for x in guesses), mp.mpf(1)]


def collocation_matrix(c):
    """A_ij = ∫_0^{c_i} ℓ_j, and the last Legendre coefficient of each Lagrange polynomial ℓ_j."""
    s = len(c)
    powers, integrals = mp.matrix(s, s), mp.matrix(s, s)
    for i in range(s):
        for k in range(s):
            powers[i, k], integrals[i, k] = c[i] ** k, c[i] ** (k + 1) / (k + 1)
    inverse = powers**-1
    return integrals * inverse, [inverse[s - 1, j] / mp.binomial(2 * s - 2, s - 1) for j in range(s)]


def solve(f, jacobian, x, start, end, tolerance, stages=9, digits=32):
    """x at ``end`` of ẋ = ``f(x)``, in ``digits`` digits; numbers may be given as decimal strings.

    ``tolerance`` bounds h times the last Legendre coefficient of ẋ, relative to each component: a quantity of order
    ``stages``, far above the error, which is of order 2 ``stages`` − 1.
    """
    with mp.workdps(digits):
        A, tail = collocation_matrix(radau_points(stages))
        t, end, x, h = mp.mpf(start), mp.mpf(end), [mp.mpf(v) for v in x], mp.mpf("1e-8")
        while t < end:
            h = min(h, end - t)
            Z, rates = _stages(f, jacobian, x, h, A, digits)
            if Z is None:
                h /= 4
                continue
            coefficients = [mp.fdot(tail, column) for column in zip(*rates, strict=True)]
            scales = [abs(v) + abs(z) + mp.mpf("1e-30") for v, z in zip(x, Z[-1], strict=True)]
            error = max(float(h * abs(a) / scale) for a, scale in zip(coefficients, scales, strict=True))
            if error <= tolerance:
                t, x = t + h, _sum(x, Z[-1])
            h *= min(4.0, max(0.1, 0.8 * (tolerance / max(error, 1e-300)) ** (1 / stages)))
        return x


def _stages(f, jacobian, x, h, A, digits):
    """Z = h A f(x + Z) and the rates there, or None twice where the iteration does not converge."""
    s, n = A.rows, len(x)
    A_float = np.array(A.tolist(), dtype=float)
    J = jacobian([float(v) for v in x])
    inverse = np.linalg.inv(np.eye(s * n) - float(h) * np.kron(A_float, J))
    Z, last = [[mp.mpf(0)] * n for _ in range(s)], float("inf")
    for _ in range(MANY_ITERATIONS):
        rates = [f(_sum(x, z)) for z in Z]
        columns = list(zip(*rates, strict=True))
        residual = [[Z[i][k] - h * mp.fdot(A[i, :], columns[k]) for k in range(n)] for i in range(s)]
        correction = (inverse @ np.array(residual, dtype=float).ravel()).reshape(s, n)
        size = np.max(np.abs(correction) / [float(abs(v)) + 1e-30 for v in x])
        if not size < 0.7 * last:
            break
        Z = [_sum(z, map(mp.mpf, -row)) for z, row in zip(Z, correction, strict=True)]
        if size < 10.0 ** (6 - digits):
            return Z, rates
        last = size
    return None, None


def _sum(a, b):
    return [u + v for u, v in zip(a, b, strict=True)]
