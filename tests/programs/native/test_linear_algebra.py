"""Factorisations and solutions of matrices."""

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
import pytest
from jax import lax

from jaxball.programs.native.ir.elements import UnsupportedError
from jaxball.programs.native.targets import machine
from tests.support.sentences import refuses

from .comparison import native

TYPES = ["float32", "float64", "complex64", "complex128"]


def matrices(dtype, *shape):
    rng = np.random.default_rng(6)
    numbers = rng.normal(size=shape) + (1j * rng.normal(size=shape) if dtype.startswith("complex") else 0)
    return (numbers + 2 * np.eye(*shape[-2:])).astype(dtype)


def near(f, *args, roundings=200):
    """Asserts that both compilers give the same to some roundings of the largest number of each array."""
    found, expected = native(f, *args), jax.jit(f)(*args)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert one.aval == other.aval
        finite = other[jnp.isfinite(other)]
        scale = np.max(np.abs(finite), initial=1.0) if other.dtype.kind in "fc" else 0
        eps = np.finfo(other.dtype).eps if other.dtype.kind in "fc" else 0
        np.testing.assert_allclose(one, other, rtol=0, atol=roundings * eps * scale)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [(1, 1), (12, 12), (2, 3, 2, 2), (2, 0, 0), (0, 2, 2)])
@pytest.mark.parametrize("dtype", TYPES)
def test_square_matrices(dtype, shape):
    a = matrices(dtype, *shape)
    right = matrices(dtype, *shape[:-1], 2)
    positive = a @ np.conj(np.swapaxes(a, -1, -2)) + np.eye(shape[-1], dtype=dtype)

    def solved(a, p, b):
        return {
            "lu": lax.linalg.lu(a),
            "solve": jnp.linalg.solve(a, b),
            "inverse": jnp.linalg.inv(a),
            "cholesky": jnp.linalg.cholesky(p),
            "upper": lax.linalg.cholesky(p),
            "eigenvalues": jnp.linalg.eigvalsh(p),
            "singular values": jnp.linalg.svd(a, compute_uv=False),
        }

    near(solved, a, positive, right, roundings=2000)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "options", [{"lower": True}, {"transpose_a": True}, {"unit_diagonal": True, "left_side": True}]
)
@pytest.mark.parametrize("dtype", TYPES)
def test_triangular_solutions(dtype, options):
    a, b = matrices(dtype, 4, 4), matrices(dtype, 4, 4)
    near(lambda a, b: lax.linalg.triangular_solve(a, b, **options), a, b)
    options = {"transpose_a": True, **options}
    near(lambda a, b: lax.linalg.triangular_solve(a, b, conjugate_a=True, **options), a, b)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [(5, 3), (2, 1, 3)])
@pytest.mark.parametrize("dtype", TYPES)
def test_factors_give_the_matrix(dtype, shape):
    """Vectors have signs of their own, products have not."""
    a = matrices(dtype, *shape)

    def factors(a):
        hermitian = a @ jnp.conj(a.mT)
        values, vectors = jnp.linalg.eigh(hermitian)
        u, s, v = jnp.linalg.svd(a, full_matrices=False)
        q, r = jnp.linalg.qr(a)
        whole = jnp.linalg.qr(a, mode="complete")
        full = jnp.linalg.svd(a)
        return (
            hermitian,
            (vectors * values[..., None, :].astype(a.dtype)) @ jnp.conj(vectors.mT),
            a,
            (u * s[..., None, :].astype(a.dtype)) @ v,
            q @ r,
            (
                whole[0] @ whole[1],
                [full[k] @ jnp.conj(full[k].mT) for k in (0, 2)],
            ),
        )

    hermitian, again, a, *products, others = native(factors, a)
    eps = np.finfo(dtype).eps
    np.testing.assert_allclose(again, hermitian, atol=200 * eps)
    for product in (*products, others[0]):
        np.testing.assert_allclose(product, a, atol=60 * eps)
    for product in others[1]:
        np.testing.assert_allclose(product, np.broadcast_to(np.eye(product.shape[-1]), product.shape), atol=60 * eps)


@pytest.mark.parametrize("dtype", TYPES)
def test_eigenvectors_of_any_matrix(dtype):
    a = matrices(dtype, 3, 5, 5)

    def eigen(a):
        values, vectors = jnp.linalg.eig(a)
        left = lax.linalg.eig(a, compute_left_eigenvectors=True, compute_right_eigenvectors=False)
        return values, vectors, left, jnp.linalg.eigvals(a.at[1, 2, 2].set(jnp.nan))

    values, vectors, (again, left), broken = jax.tree.map(np.asarray, native(eigen, a))
    eps = 300 * np.finfo(dtype).eps
    np.testing.assert_allclose(a @ vectors, vectors * values[:, None], atol=eps)
    left = np.conj(np.swapaxes(left, 1, 2))
    np.testing.assert_allclose(left @ a, again[..., None] * left, atol=eps)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=eps)
    np.testing.assert_array_equal(np.isnan(broken).any(1), [False, True, False])


@pytest.mark.parametrize("dtype", TYPES)
def test_tridiagonal_equations(dtype):
    low, middle, high = matrices(dtype, 3, 2, 5)
    near(lambda *d: lax.linalg.tridiagonal_solve(*d, d[0][..., None] + 1), low, middle + 5, high)


@pytest.mark.thorough
@pytest.mark.parametrize("number", [np.nan, np.inf, 0.0])
def test_matrices_without_a_solution(number):
    a = matrices("float64", 3, 3)
    a[1] = number
    near(lambda a: (jnp.linalg.solve(a, a[0]), lax.linalg.lu(a), jnp.linalg.cholesky(a @ a.T)), a)


@pytest.mark.thorough
def test_derivatives_and_loops():
    a = matrices("float64", 3, 3)

    def iterated(a):
        return lax.fori_loop(0, 5, lambda i, x: jnp.linalg.solve(a + 3 * jnp.eye(3), x) + 1, jnp.ones(3))

    near(lambda a: (jax.jacfwd(iterated)(a), jax.grad(lambda a: jnp.linalg.slogdet(a)[1])(a), jsl.expm(a)), a)


def test_without_a_routine(monkeypatch):
    monkeypatch.setattr(machine, "routine", lambda library, name: None)
    with refuses(UnsupportedError, "SciPy"):
        native(jnp.linalg.inv, np.eye(3))
