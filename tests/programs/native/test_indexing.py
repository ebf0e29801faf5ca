"""Indices that are numbers of the program: negative ones, and those out of range, as XLA has them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from .comparison import agree, native

LENGTHS = [6, 100]  # in registers, and in memory
INDICES = np.array([0, 3, -1, 5, 99, -100, 1000, 2**31 - 1])


def numbers(*shape):
    return np.random.default_rng(1).normal(size=shape)


@pytest.mark.thorough
@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("dtype", ["float64", "int8", "complex128", "bool"])
def test_reading(length, dtype):
    x = (10 * numbers(length)).astype(dtype)
    for mode in ("clip", "fill", "promise_in_bounds"):
        indices = INDICES if mode != "promise_in_bounds" else np.array([0, 3, 5])
        agree(lambda x, i, mode=mode: x.at[i].get(mode=mode), x, indices)
    agree(lambda x, i: (x[i], x[i][::-1]), x, INDICES)


@pytest.mark.parametrize("length", LENGTHS)
def test_slices_that_move(length):
    x = numbers(length, 3)

    def slices(x, i, j):
        return (
            lax.dynamic_slice(x, (i, j), (4, 2)),
            lax.dynamic_slice(x, (i, np.int8(0)), (length, 3)),
            lax.dynamic_update_slice(x, x[:4, :2] * 2, (i, j)),
            lax.dynamic_index_in_dim(x, i, 0, keepdims=False),
        )

    for i in (-7, -1, 0, 2, length - 1, length + 5):
        agree(slices, x, np.int8(i), np.int8(1))


@pytest.mark.thorough
@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("mode", ["drop", "clip"])
def test_writing(length, mode):
    x, new = numbers(length), numbers(INDICES.size)

    def written(x, i, new):
        at = x.at[i]
        return [
            write(new, mode=mode) for write in (at.set, at.add, at.multiply, at.min, at.max)
        ] + [x.at[i].set(7.0, mode=mode, unique_indices=False)]  # fmt: skip

    agree(written, x, INDICES[:-1], new[:-1])
    agree(lambda x, new: x.at[jnp.array([1, 1, 3])].add(new), x, new[:3])


@pytest.mark.parametrize("length", LENGTHS)
def test_rows_and_columns(length):
    x, i = numbers(length, 4), np.array([[0, 2], [-1, 4]])
    j = np.array([1, 3])

    def chosen(x, i, j):
        return (x[i], x[:, j], x[i, j], x[i, 1:3], x.at[:, j].set(0.0), x.at[i, j].add(1.0), x.at[i].mul(x[:2] + 1))

    agree(chosen, x, i, j)


def test_along_a_batch():
    """Dimensions of a batch, in gather and in scatter."""
    x, i = numbers(5, 20), np.array([3, -1, 0, 19, 40])
    agree(jax.vmap(lambda x, i: (x[i], x.at[i].set(1.0))), x, i)
    agree(jax.vmap(lambda x, i: lax.dynamic_update_slice(x, x[:2], (i,))), x, i)
    agree(lambda x, i: jnp.take_along_axis(x, i[:, None], axis=1), x, i)
    agree(jax.grad(lambda x, i: jnp.sum(jnp.take(x, i, axis=1) ** 2)), x, i[:3])


def test_what_is_read_before_it_is_overwritten():
    x = numbers(100)

    def program(x, i):
        x = 2 * x
        before = x[::-1]  # nothing that is computed at once
        x = x.at[i].set(1e3)
        return before + x

    agree(program, x, 7)


@pytest.mark.parametrize("length", LENGTHS)
def test_arguments_are_not_overwritten(length):
    x = numbers(length)
    given = x.copy()
    native(lambda x, i: x.at[i].set(0.0), x, 3)
    np.testing.assert_array_equal(x, given)


def test_updates_within_a_loop():
    x = numbers(100, 3)

    def filled(x):
        def body(i, carry):
            x, y = carry
            row = lax.dynamic_index_in_dim(x, i, 0)
            return lax.dynamic_update_slice(x, row + x[:1], (i + 1, 0)), y.at[i % 3].add(row[0, 0])

        return lax.fori_loop(0, 90, body, (x, jnp.zeros(3)))

    agree(filled, x, ulps=200)
