"""The coefficients of the collocation methods against 50 digits, published numbers and the conditions for order."""

import functools

import mpmath as mp
import numpy as np
import pytest

from jaxball.simulation.solvers.tableau import gauss, integrals, radau_right
from tests.support.collocation import radau_points

DIGITS = 50
METHODS = [
    *(pytest.param(gauss, s, id=f"Gauss, {s} stages") for s in (2, 3, 4, 5, 8, 12, 16, 20)),
    *(pytest.param(radau_right, s, id=f"Radau IIA, {s} stages") for s in (3, 5, 7)),
]
# Those that SimplifiedNewton takes apart into modes.
WITH_MODES = METHODS[:6] + METHODS[8:]


@functools.cache
def many_digits(family, s):
    """c, b, A and A⁻¹ in 50 digits, from Lagrange's polynomials on the roots of Legendre's."""
    with mp.workdps(DIGITS):
        if family is radau_right:
            c = radau_points(s)
        else:
            guesses = (np.polynomial.legendre.leggauss(s)[0] + 1) / 2
            c = [mp.findroot(lambda x: mp.legendre(s, 2 * x - 1), guess) for guess in guesses]
        powers = mp.matrix(s, s)
        for i in range(s):
            for k in range(s):
                powers[i, k] = c[i] ** k
        inverse = powers**-1
        integrals_to = mp.matrix([[x ** (k + 1) / (k + 1) for k in range(s)] for x in [*c, mp.mpf(1)]])
        weights = integrals_to * inverse
        A, b = weights[:s, :], weights[s, :]
        return c, list(b), A, A**-1


def assert_close(values, truth, units):
    """``values`` equal ``truth`` to some units in the last place of the largest."""
    truth = np.array([float(x) for x in truth]).reshape(np.shape(values))
    np.testing.assert_allclose(values, truth, rtol=0, atol=units * np.finfo(float).eps * np.max(np.abs(truth)))


@pytest.mark.parametrize(("family", "s"), METHODS)
def test_nodes_and_weights(family, s):
    c, b, _, _ = many_digits(family, s)
    assert_close(family(s).c, c, 1)
    assert_close(family(s).b, b, 30)


@pytest.mark.parametrize(("family", "s"), METHODS)
def test_matrix_and_its_inverse(family, s):
    _, _, A, A_inverse = many_digits(family, s)
    assert_close(family(s).A, A, 30)
    assert_close(family(s).A_inverse, A_inverse, 150)


@pytest.mark.parametrize(("family", "s"), METHODS)
def test_quadrature_is_exact_up_to_the_order(family, s):
    """B(p): Σ bᵢcᵢᵏ⁻¹ = 1/k for k ≤ p, and not for p + 1."""
    tableau, order = family(s), 2 * s - (family is radau_right)
    sums = [np.sum(tableau.b * tableau.c ** (k - 1)) for k in range(1, order + 1)]
    np.testing.assert_allclose(sums, 1 / np.arange(1, order + 1), rtol=0, atol=1e-15)
    with mp.workdps(DIGITS):
        c, b, _, _ = many_digits(family, s)
        one_more = mp.fsum(w * x**order for w, x in zip(b, c, strict=True)) - mp.mpf(1) / (order + 1)
        assert abs(one_more) > mp.mpf(10) ** (-DIGITS + 10)


@pytest.mark.parametrize(("family", "s"), METHODS)
def test_stages_integrate_polynomials_up_to_degree_s(family, s):
    """C(s): Σ aᵢⱼcⱼᵏ⁻¹ = cᵢᵏ/k for k ≤ s."""
    tableau, k = family(s), np.arange(1, s + 1)
    powers = tableau.c[:, None] ** (k - 1)
    np.testing.assert_allclose(tableau.A @ powers, tableau.c[:, None] ** k / k, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("family", "s"), METHODS)
def test_weights_satisfy_the_dual_condition(family, s):
    """D(ζ): Σ bᵢcᵢᵏ⁻¹aᵢⱼ = bⱼ(1 − cⱼᵏ)/k for k ≤ ζ; ζ is s for Gauss and s − 1 for Radau IIA."""
    tableau, k = family(s), np.arange(1, s + 1 - (family is radau_right))
    powers = tableau.c ** (k[:, None] - 1)
    right = tableau.b * (1 - tableau.c ** k[:, None]) / k[:, None]
    np.testing.assert_allclose((tableau.b * powers) @ tableau.A, right, rtol=0, atol=1e-15)


def test_order_follows_from_the_simplifying_assumptions_only_if_they_are_strong_enough():
    """Butcher's theorem: B(p), C(η), D(ζ) with p ≤ η + ζ + 1 and p ≤ 2η + 2 give order p."""
    for s in range(2, 21):
        assert 2 * s <= min(s + s + 1, 2 * s + 2)
        assert 2 * s - 1 <= min(s + (s - 1) + 1, 2 * s + 2)


@pytest.mark.parametrize(("family", "s"), WITH_MODES)
def test_modes_reproduce_the_inverse(family, s):
    tableau = family(s)
    identity = (tableau.from_modes @ tableau.to_modes).real
    A_inverse = (tableau.from_modes @ (tableau.eigenvalues[:, None] * tableau.to_modes)).real
    # The modes are the less independent, the more stages there are.
    np.testing.assert_allclose(identity, np.eye(s), rtol=0, atol=1e-15 * 5**s)
    scale = np.max(np.abs(tableau.A_inverse))
    np.testing.assert_allclose(A_inverse / scale, tableau.A_inverse / scale, rtol=0, atol=1e-15 * 5**s)


@pytest.mark.parametrize(("family", "s"), WITH_MODES)
def test_eigenvalues_are_those_of_the_exact_inverse(family, s):
    with mp.workdps(DIGITS):
        eigenvalues, _ = mp.eig(many_digits(family, s)[3])
    half = sorted((complex(x) for x in eigenvalues if x.imag > -1e-20), key=lambda x: x.imag)
    np.testing.assert_allclose(family(s).eigenvalues, half, rtol=1e-14 * 2**s)


def test_eigenvalues_of_radau5_as_published():
    """γ, α ± iβ of the code radau5: Hairer & Wanner (1996), section IV.8, in closed form from eq. (8.5)."""
    real, pair = radau_right(3).eigenvalues
    assert real == pytest.approx(3.637834252744496, rel=1e-15)
    assert pair == pytest.approx(2.681082873627752 + 3.050430199247411j, rel=1e-15)
    assert 1 / real.real == pytest.approx((6 + np.cbrt(81) - np.cbrt(9)) / 30, rel=1e-15)


def test_radau_with_3_stages_as_published():
    """Hairer & Wanner (1996), Table IV.5.6."""
    r6 = np.sqrt(6)
    A = [
        [(88 - 7 * r6) / 360, (296 - 169 * r6) / 1800, (-2 + 3 * r6) / 225],
        [(296 + 169 * r6) / 1800, (88 + 7 * r6) / 360, (-2 - 3 * r6) / 225],
        [(16 - r6) / 36, (16 + r6) / 36, 1 / 9],
    ]
    np.testing.assert_allclose(radau_right(3).A, A, rtol=0, atol=2e-16)
    np.testing.assert_allclose(radau_right(3).c, [(4 - r6) / 10, (4 + r6) / 10, 1], rtol=1e-15)


def test_radau_is_stiffly_accurate():
    for s in (3, 5, 7):
        tableau = radau_right(s)
        assert tableau.c[-1] == 1
        np.testing.assert_allclose(tableau.A[-1], tableau.b, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("family", "s"), METHODS)
def test_expansion_takes_values_to_legendre_coefficients(family, s):
    tableau = family(s)
    x = np.linspace(0, 1, 7)
    for degree in range(s):
        coefficients = tableau.expansion @ np.cos(degree * np.arccos(2 * tableau.c - 1))
        values = np.polynomial.legendre.legval(2 * x - 1, coefficients)
        np.testing.assert_allclose(values, np.cos(degree * np.arccos(2 * x - 1)), rtol=0, atol=2e-14)


def test_integrals_of_legendre_polynomials():
    x = np.array([0.0, 0.3, 0.77, 1.0])
    with mp.workdps(30):
        truth = [
            [float(mp.quad(lambda t, k=k: mp.legendre(k, 2 * t - 1), [0, mp.mpf(u)])) for k in range(6)] for u in x
        ]
    np.testing.assert_allclose(integrals(x, 6), truth, rtol=0, atol=1e-15)
