"""Reductions, windows, products and sorting."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from .comparison import agree, special

SHAPES = [(3, 4), (1, 1), (2, 0), (0, 3), (20, 30), (3, 200), (200, 3), (5, 81)]


def numbers(*shape):
    return np.random.default_rng(2).uniform(0.5, 1.5, size=shape)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", SHAPES)
def test_over_dimensions(shape):
    x = numbers(*shape)

    def reduced(x):
        axes = [(0,), (1,), (0, 1), ()]
        return [
            f(x, axis)
            for f in (
                jnp.sum,
                jnp.prod,
                lambda x, axis: jnp.max(x, axis, initial=0.0),
                lambda x, axis: jnp.all(x > 1, axis),
            )
            for axis in axes
        ]

    agree(reduced, x, ulps=600)


@pytest.mark.parametrize("shape", [(3, 4), (20, 30)])
@pytest.mark.parametrize("dtype", ["float64", "int32", "uint8", "complex128"])
def test_types(shape, dtype):
    x = (10 * numbers(*shape)).astype(dtype)
    agree(
        lambda x: (jnp.sum(x, 0, dtype=x.dtype), jnp.prod(x[:2], 0, dtype=x.dtype), jnp.cumsum(x, 1, dtype=x.dtype)),
        x,
        ulps=100,
    )


@pytest.mark.parametrize("repeated", [1, 5])
def test_places_of_extremes(repeated):
    x = np.tile(special("float64"), repeated).reshape(-1, 2)
    finite = np.where(np.isnan(x), 0.0, x)
    agree(lambda x: (jnp.argmax(x), jnp.argmin(x, 0), jnp.argmax(x, 1), jnp.nanmax(x), jnp.max(x)), x)
    agree(lambda x: (jnp.argmax(x), jnp.argmin(x, 0), jnp.argmax(x, 1)), finite)


@pytest.mark.parametrize("length", [1, 5, 70])
def test_running(length):
    x = numbers(length, 3)

    def running(x):
        return (
            jnp.cumsum(x, 0),
            jnp.cumprod(x, 0),
            lax.cummax(x, 0, reverse=True),
            lax.cumlogsumexp(x, 0),
            lax.associative_scan(jnp.multiply, x),
        )

    agree(running, x, ulps=400)


@pytest.mark.parametrize("shape", [(6, 5), (12, 11)])
def test_windows(shape):
    x = numbers(*shape)

    def windows(x):
        return (
            lax.reduce_window(x, 0.0, lax.add, (2, 3), (1, 1), "SAME"),
            lax.reduce_window(x, -np.inf, lax.max, (2, 2), (2, 3), "VALID"),
            lax.reduce_window(x, 1.0, lax.mul, (2, 2), (1, 2), ((1, 0), (0, 2)), (2, 1), (1, 2)),
        )

    agree(windows, x, ulps=10)


@pytest.mark.parametrize("shape", [(5, 6), (11, 12)])
@pytest.mark.parametrize("padding", ["VALID", "SAME"])
def test_derivatives_of_windows(shape, padding):
    """Of equal numbers the first is chosen."""
    x = np.random.default_rng(5).integers(0, 4, shape).astype(float)

    def largest(x, size, strides):
        return jnp.sum(lax.reduce_window(x, -np.inf, lax.max, size, strides, padding) ** 2)

    agree(lambda x: (jax.grad(largest)(x, (2, 3), (2, 3)), jax.grad(largest)(x, (3, 2), (1, 1))), x, ulps=10)


@pytest.mark.thorough
@pytest.mark.parametrize("n", [1, 3, 12, 40])
@pytest.mark.parametrize("dtype", ["float64", "float32", "int32", "complex128"])
def test_products(n, dtype):
    rng = np.random.default_rng(3)
    a, b = ((10 * rng.uniform(0.1, 1, size=(n, n))).astype(dtype) for _ in range(2))
    agree(
        lambda a, b: (a @ b, a @ b[0], a[0] @ b[0], jnp.einsum("ij,ij->i", a, b), jnp.tensordot(a, b, 2)), a, b, ulps=40
    )


def test_products_of_batches():
    a, b = numbers(4, 2, 3), numbers(4, 3, 5)
    agree(lambda a, b: (a @ b, jnp.einsum("bij,bjk->kib", a, b), jnp.einsum("bij,cjk->bc", a, b)), a, b, ulps=20)
    agree(lambda a: (jnp.zeros((3, 0)) @ jnp.zeros((0, 2)), a[:, :0] @ a[:, :0].swapaxes(1, 2)), a)


@pytest.mark.thorough
@pytest.mark.parametrize("length", [1, 2, 3, 16, 17, 70, 257])
def test_sorting(length):
    x = np.random.default_rng(4).normal(size=(2, length)).round(1)
    x[0, : length // 3] = np.resize(special("float64"), length // 3)
    agree(lambda x: (jnp.sort(x), jnp.sort(x, 0), jnp.argsort(x), jnp.sort(x, descending=True)), x)


@pytest.mark.thorough
@pytest.mark.parametrize("length", [5, 70])
def test_sorting_several_together(length):
    rng = np.random.default_rng(5)
    keys, others = rng.integers(0, 4, length), rng.integers(0, 3, length).astype(np.uint8)
    agree(lambda k, o, x: lax.sort((k, o, x), num_keys=2), keys, others, np.arange(length).astype(complex))
    agree(lambda k: (jnp.unique(k, size=4), jnp.searchsorted(jnp.sort(k), 2), jnp.median(k.astype(float))), keys)


def test_random_numbers():
    """Bits are the same, so that runs with random numbers are."""
    f = lambda seed: (jax.random.bits(jax.random.key(seed), (70,)), jax.random.uniform(jax.random.key(seed), (5,)))  # noqa: E731
    agree(f, 3)
    agree(lambda seed: jax.random.permutation(jax.random.key(seed), 20), 3)
