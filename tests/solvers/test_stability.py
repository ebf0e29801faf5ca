"""Stability functions, measured by one step on y′ = λy, against the rational functions that they should be.

Hairer & Wanner (1996), section IV.3: R is the Padé approximant of exp with degrees (s − 1, s) for Radau IIA and (s, s)
for Gauss (Theorem 3.11 gives its coefficients, Theorems 5.3 and 5.5 the methods).
"""

import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

from jaxball.simulation import solvers
from tests.solvers.fixed_steps import NEWTON
from tests.solvers.linear_fields import rotation

DIGITS = 40


def pade(j, k):
    """The Padé approximant of exp with a numerator of degree ``j`` and a denominator of degree ``k``."""

    def sums(z, j, k):
        return mp.fsum(mp.binomial(j, i) * mp.factorial(j + k - i) / mp.factorial(j + k) * z**i for i in range(j + 1))

    return lambda z: sums(z, j, k) / sums(-z, k, j)


def trapezoidal(z):
    """(1 + z/2)/(1 − z/2), the Padé approximant (1, 1)."""
    return (2 + z) / (2 - z)


def tr_bdf2(z):
    """The trapezoidal rule to γ = 2 − √2, then BDF2 through 0, γ and 1 (Bank et al. 1985)."""
    g = 2 - mp.sqrt(2)
    middle = (1 + g * z / 2) / (1 - g * z / 2)
    return (middle - (1 - g) ** 2) / (g * (2 - g)) / (1 - (1 - g) / (2 - g) * z)


METHODS = [
    *(pytest.param(solvers.RadauIIA(s, root_finder=NEWTON), pade(s - 1, s), id=f"Radau IIA, {s}") for s in (3, 5)),
    *(pytest.param(solvers.Gauss(s, root_finder=NEWTON), pade(s, s), id=f"Gauss, {s}") for s in (3, 4)),
    pytest.param(solvers.Trapezoidal(root_finder=NEWTON), trapezoidal, id="trapezoidal rule"),
    pytest.param(solvers.TRBDF2(root_finder=NEWTON), tr_bdf2, id="TR-BDF2"),
]
L_STABLE = [METHODS[0], METHODS[1], METHODS[-1]]
SYMMETRIC = METHODS[2:5]

# From a step that resolves λ to the stiffest, in many directions of the left half plane, and a few on the right.
SIZES = [1e-3, 0.1, 1.0, 3.0, 10.0, 30.0, 1e2, 1e4, 1e6, 1e8]
DIRECTIONS = np.array([1j, -0.01 + 1j, -0.3 + 1j, -1 + 1j, -1, -1 - 0.6j, -0.1 - 1j, -1j])
Z = np.concatenate([np.outer(DIRECTIONS / np.abs(DIRECTIONS), SIZES).ravel(), [0.1, 1.0, 0.5 + 1j, 1.5 - 0.7j]])
IN_THE_LEFT, ON_THE_AXIS = Z.real <= 0, Z.real == 0
ROUNDING = 2e-14


@eqx.filter_jit
def _steps(solver, parts):
    term, start = diffrax.ODETerm(rotation), jnp.array([1.0, 0.0])
    t0, t1 = jnp.array(0.0), jnp.array(1.0)

    def step(z):
        y, *_, result = solver.step(term, t0, t1, start, z, solver.init(term, t0, t1, start, z), False)
        return y, result == diffrax.RESULTS.successful

    return jax.vmap(step)(parts)


@functools.cache
def amplification(solver):
    """R(z) at each of ``Z``: y after one step of length 1 on y′ = zy from y = 1."""
    y, ok = _steps(solver, jnp.stack([Z.real, Z.imag], axis=1))
    assert np.all(ok)
    return np.asarray(y) @ np.array([1, 1j])


def exactly(function, z):
    """``function`` in many digits at each of ``z``."""
    with mp.workdps(DIGITS):
        return np.array([complex(function(mp.mpc(x))) for x in z])


@pytest.mark.thorough
@pytest.mark.parametrize(("solver", "function"), METHODS)
def test_stability_function_is_the_known_rational_function(solver, function):
    np.testing.assert_allclose(amplification(solver), exactly(function, Z), rtol=0, atol=ROUNDING)


@pytest.mark.thorough
@pytest.mark.parametrize(("solver", "function"), METHODS)
def test_a_stable(solver, function):
    assert np.all(np.abs(amplification(solver)[IN_THE_LEFT]) <= 1 + ROUNDING)


@pytest.mark.thorough
@pytest.mark.parametrize(("solver", "function"), L_STABLE)
def test_l_stable(solver, function):
    """|R| falls as 1/|z|, because the degree of its denominator is greater by one."""
    stiff = IN_THE_LEFT & (np.abs(Z) >= 1e4)
    leading = abs(exactly(function, [-1e12])[0]) * 1e12
    np.testing.assert_allclose(np.abs(amplification(solver)[stiff] * Z[stiff]), leading, rtol=1e-2, atol=1e-4)


@pytest.mark.thorough
@pytest.mark.parametrize(("solver", "function"), SYMMETRIC)
def test_symmetric_methods_neither_damp_nor_amplify_oscillations(solver, function):
    imaginary = amplification(solver)[ON_THE_AXIS]
    assert len(imaginary) == 2 * len(SIZES)
    np.testing.assert_allclose(np.abs(imaginary), 1, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize(("solver", "function"), SYMMETRIC)
def test_symmetric_methods_do_not_damp_what_is_stiff(solver, function):
    """R(∞) = (−1)ˢ."""
    stiffest = amplification(solver)[np.abs(Z) > 1e7]
    np.testing.assert_allclose(stiffest, (-1) ** getattr(solver, "stages", 1), rtol=0, atol=1e-5)
