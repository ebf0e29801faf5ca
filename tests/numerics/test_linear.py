"""Inverses of small matrices, several at once, beside LAPACK's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.numerics.linear import complex_inverses, inverse, inverses

rng = np.random.default_rng(11)
COMPILERS = {"native": jaxball.jit, "xla": jax.jit}


def matrices(count, n):
    """Matrices that need an exchange of rows: the first has only zeros on its diagonal."""
    A = rng.normal(size=(count, n, n))
    A[0] = np.roll(np.diag(1 + np.arange(n, dtype=float)), 1, axis=0)
    return A


@pytest.mark.thorough
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(("count", "n"), [(1, 1), (7, 2), (3, 9), (1, 40)])
def test_inverses(compiler, count, n):
    A = matrices(count, n)
    exact, condition = np.linalg.inv(A), np.max(np.linalg.cond(A))
    found = COMPILERS[compiler](inverses)(A)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-15 * n * condition * np.max(np.abs(exact)))


@pytest.mark.thorough
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(("count", "n"), [(1, 3), (7, 9), (1, 40)])
def test_complex_inverses(compiler, count, n):
    A = matrices(count, n) + 1j * np.roll(matrices(count, n), 1, axis=0)
    exact, condition = np.linalg.inv(A), np.max(np.linalg.cond(A))
    found = COMPILERS[compiler](complex_inverses)(A.real, A.imag)
    found = np.asarray(found[0]) + 1j * np.asarray(found[1])
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-15 * n * condition * np.max(np.abs(exact)))


@pytest.mark.thorough
@pytest.mark.parametrize("compiler", COMPILERS)
def test_matrices_whose_rows_stay_in_place(compiler):
    A = rng.normal(size=(7, 9, 9)) + 20 * np.eye(9)
    np.testing.assert_allclose(COMPILERS[compiler](inverses)(A), np.linalg.inv(A), rtol=0, atol=1e-15)
    real, imaginary = map(np.asarray, COMPILERS[compiler](complex_inverses)(A, np.roll(A, 1, axis=0)))
    exact = np.linalg.inv(A + 1j * np.roll(A, 1, axis=0))
    np.testing.assert_allclose(real + 1j * imaginary, exact, rtol=0, atol=1e-15)


@pytest.mark.parametrize("compiler", COMPILERS)
def test_that_of_a_singular_matrix_is_not_finite(compiler):
    A = np.array([np.eye(3), np.diag([1.0, 0.0, 2.0])])
    found = np.asarray(COMPILERS[compiler](inverses)(A))
    np.testing.assert_array_equal(found[0], np.eye(3))
    assert not np.all(np.isfinite(found[1]))
    real, imaginary = COMPILERS[compiler](complex_inverses)(A, jnp.zeros_like(A))
    assert np.all(np.isfinite(real[0]))
    assert not np.all(np.isfinite(real[1] + imaginary[1]))


@pytest.mark.thorough
@pytest.mark.parametrize("compiler", COMPILERS)
def test_derivatives_of_an_inverse_of_any_order(compiler):
    """Of a sum of entries of (A + x B)⁻¹, beside those of LAPACK's, in both modes and twice."""
    A, B = rng.normal(size=(2, 4, 4))
    A += 4 * np.eye(4)

    def derivatives(invert):
        def total(x):
            return jnp.sum(jnp.sin(invert(jnp.asarray(A) + x * jnp.asarray(B))))

        return lambda x: jnp.stack([jax.grad(total)(x), jax.jacfwd(total)(x), jax.hessian(total)(x)])

    found = COMPILERS[compiler](derivatives(inverse))(jnp.array(0.3))
    np.testing.assert_allclose(found, jax.jit(derivatives(jnp.linalg.inv))(jnp.array(0.3)), rtol=1e-12)
