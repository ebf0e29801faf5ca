"""Piecewise polynomials against NumPy's, and matrices of which half is computed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.functions import MOST_CHOSEN, PiecewisePolynomial
from jaxball.numerics.vectors import on_diagonal, symmetric


def curve_of(breaks: int) -> PiecewisePolynomial:
    random = np.random.default_rng(breaks)
    places = np.cumsum(random.uniform(0.5, 1.0, breaks))
    origins, coefficients = random.normal(size=breaks + 1), random.normal(size=(breaks + 1, 3))
    return PiecewisePolynomial(jnp.asarray(places), jnp.asarray(origins), jnp.asarray(coefficients))


@pytest.mark.parametrize("breaks", [0, 1, 2, 3, 4, 6, 7, MOST_CHOSEN, MOST_CHOSEN + 1])
def test_a_piecewise_polynomial_is_that_of_the_piece(breaks):
    curve = curve_of(breaks)
    places = np.asarray(curve.breaks)
    x = np.concatenate([[-1.0], places, np.nextafter(places, -np.inf), places + 0.2])
    piece = np.searchsorted(places, x, side="right")
    exact = [
        np.polyval(np.asarray(curve.coefficients)[k][::-1], at - np.asarray(curve.origins)[k])
        for k, at in zip(piece, x, strict=True)
    ]
    np.testing.assert_allclose(jax.vmap(curve)(x), exact, rtol=1e-12)


def test_a_symmetric_matrix_has_what_is_above_its_diagonal_twice():
    A = np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(symmetric(jnp.asarray(A)), np.triu(A) + np.triu(A, 1).T)


def test_numbers_on_a_diagonal_change_no_sign_of_a_zero():
    zeros = jnp.full((3, 3), -0.0)
    np.testing.assert_array_equal(on_diagonal(jnp.asarray([1.0, 2.0, 3.0])), np.diag([1.0, 2.0, 3.0]))
    assert np.all(np.signbit(zeros + on_diagonal(jnp.asarray(-0.0))))
