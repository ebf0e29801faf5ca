"""Operations that move elements, of arrays in registers and of larger ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxball.programs.native.pipeline import emit, read_functions

from .comparison import agree

# Of each kind one that is kept in registers, and one that is not.
SHAPES = [(2, 3, 4), (5, 6, 7)]


def numbers(shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape)


@pytest.mark.parametrize("shape", SHAPES)
def test_moves(shape):
    def moves(x):
        return (
            x.transpose(2, 0, 1),
            x.reshape(shape[0], -1),
            x.reshape(-1),
            x.reshape(1, *shape, 1),
            x.reshape(shape[::-1]),
            x[:, 1:, ::2],
            x[::-1, :, ::-1],
            x[0],
            jnp.broadcast_to(x[:, :1], shape),
            jnp.broadcast_to(x[0, 0], (9, 8, shape[2])),
            lax.broadcast_in_dim(x[0], (shape[1], 11, shape[2]), (0, 2)),
        )

    agree(moves, numbers(shape))


@pytest.mark.parametrize("dtype", [float, complex, np.int32, bool])
def test_a_constant_that_repeats_its_numbers_holds_them_once(dtype):
    few, shape = jnp.array([2.0, -0.0, 3.0], dtype), (4, 3, 50, 60)

    def repeated(x):
        rows = jnp.broadcast_to(few[:, None, None], shape)
        return (
            jnp.where(x > 0, rows, few[0]),
            jnp.where(x > 0, lax.broadcast_in_dim(few, shape, (1,)), rows),
            rows[:, :0],
        )

    agree(repeated, numbers(shape))
    agree(jax.vmap(lambda x: jnp.where(x > 0, jnp.broadcast_to(few[:, None, None], shape[1:]), few[2])), numbers(shape))
    module = jax.jit(repeated).lower(numbers(shape)).compiler_ir("stablehlo")
    assert (
        len(emit(read_functions(module, 1)).main.body) < 20_000
    )  # 36,000 numbers would be of 100,000 characters or more


@pytest.mark.parametrize("shape", SHAPES)
def test_moves_of_what_is_computed(shape):
    """Formulas within formulas, which are read in another order than they lie in."""
    agree(lambda x: (2 * x).transpose(2, 1, 0)[::-1, 1:] + 1, numbers(shape))
    agree(lambda x: (x + x.transpose(0, 1, 2)[:, ::-1]).reshape(-1)[3:], numbers(shape))


@pytest.mark.parametrize("shape", SHAPES)
def test_concatenation_and_padding(shape):
    def joined(x):
        return (
            jnp.concatenate([x, 2 * x, x[:, :1]], axis=1),
            jnp.stack([x, -x], axis=-1),
            lax.pad(x, 7.0, [(1, 2, 0), (0, 0, 1), (2, 0, 3)]),
            lax.pad(x, 7.0, [(-1, 2, 0), (1, -2, 2), (0, -1, 0)]),
        )

    agree(joined, numbers(shape))


@pytest.mark.thorough
@pytest.mark.parametrize("dtype", ["float64", "float32", "int32", "uint8", "complex128", "bool"])
@pytest.mark.parametrize("length", [4, 70])
def test_types(dtype, length):
    x = np.arange(3 * length).reshape(3, length).astype(dtype)
    agree(lambda x: (x.T, x[:, 1:3], jnp.concatenate([x, x]), jnp.pad(x, 1), x.reshape(-1)[::-1]), x)


@pytest.mark.parametrize("shape", [(3,), (2, 5, 3), (30, 4)])
@pytest.mark.parametrize("dtype", ["float64", "int16", "complex128"])
def test_own_indices(shape, dtype):
    agree(lambda: [lax.broadcasted_iota(dtype, shape, k) for k in range(len(shape))])


@pytest.mark.parametrize("shape", [(0,), (3, 0), (1,), ()])
def test_empty_and_single(shape):
    x = numbers(shape)
    agree(lambda x: (x.reshape(-1), x[None], jnp.concatenate([x[None], x[None]]), jnp.pad(x, 2), x.T), x)
