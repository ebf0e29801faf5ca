"""Small programs drawn at random: expressions, loops, branches and slices, against XLA."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from jax import lax

from .comparison import native

# Of arrays of one shape. None grows what it is given, so that rounding stays rounding; indices that are numbers of the
# program lie off the integers, so that rounding changes none.
UNARY = [
    jnp.sin,
    jnp.tanh,
    lambda x: x[::-1],
    lambda x: jnp.roll(x, 1),
    jnp.abs,
    lambda x: -x,
    lambda x: x * 0.5 + 0.25,
    jnp.sort,
    lambda x: x[jnp.argsort(-x)],
    lambda x: jnp.cumsum(x) / x.size,
    lambda x: lax.cummax(x, reverse=True),
    lambda x: jnp.zeros_like(x).at[(7 * jnp.abs(x) + 0.3).astype(int)].add(0.1 * x),
    lambda x: x[(99 * x + 0.3).astype(np.int8)],
    lambda x: 0.3 * jnp.concatenate([x[1:], x[:1]]) + 0.5 * jnp.pad(x[:-1], (1, 0)),
    lambda x: jnp.real(jnp.exp(lax.complex(-abs(x), x)) * lax.complex(x, x) / 2),
    lambda x: lax.map(lambda y: y * jnp.abs(y), x),
    lambda x: jnp.linalg.solve(jnp.eye(2) + 0.1 * jnp.outer(x[:2], x[:2]), x[:2])[0] * x / 2,
    lambda x: jnp.outer(x, x[:3]) @ jnp.ones(3) / 3,
]
BINARY = [
    jnp.minimum,
    jnp.maximum,
    lambda x, y: 0.5 * (x + y),
    lambda x, y: x * y,
    lambda x, y: jnp.where(x > y, x, 0.9 * y),
]


def steps(depth):
    """A step takes some arrays and gives as many: a list of such is a program."""
    place = st.integers(0, 2)
    plain = st.one_of(
        st.tuples(st.just("unary"), st.integers(0, len(UNARY) - 1), place, place),
        st.tuples(st.just("binary"), st.integers(0, len(BINARY) - 1), place, place, place),
        st.tuples(st.just("set"), place, place, st.integers(-2, 9)),
        st.tuples(st.just("slice"), place, place),
        st.tuples(st.just("exchange"), place, place),
    )
    if not depth:
        return st.lists(plain, min_size=1, max_size=4)
    inner = steps(depth - 1)
    nested = st.one_of(
        plain,
        st.tuples(st.just("loop"), st.integers(0, 3), inner),
        st.tuples(st.just("branch"), place, inner, inner),
        st.tuples(st.just("scan"), place, inner),
    )
    return st.lists(nested, min_size=1, max_size=4)


def follow(program, arrays, i):
    """The arrays that a program gives; i counts turns of the loop around it."""
    arrays = list(arrays)
    for name, *how in program:
        if name == "unary":
            arrays[how[2]] = UNARY[how[0]](arrays[how[1]])
        elif name == "binary":
            arrays[how[3]] = BINARY[how[0]](arrays[how[1]], arrays[how[2]])
        elif name == "set":
            arrays[how[0]] = arrays[how[0]].at[i + how[2]].set(0.5 * arrays[how[1]][i])
        elif name == "slice":
            arrays[how[0]] = lax.dynamic_update_slice(arrays[how[0]], 0.5 * arrays[how[1]][1:3], (i,))
        elif name == "exchange":
            arrays[how[0]], arrays[how[1]] = arrays[how[1]], arrays[how[0]]
        elif name == "loop":
            arrays = list(lax.fori_loop(0, how[0], lambda j, c, inner=how[1]: follow(inner, c, j), tuple(arrays)))
        elif name == "branch":
            yes, no = (lambda c, inner=inner: follow(inner, c, i) for inner in how[1:])
            arrays = list(lax.cond(jnp.sum(arrays[how[0]]) > 0.3, yes, no, tuple(arrays)))
        else:
            arrays, last = lax.scan(
                lambda c, x, inner=how[1]: (follow(inner, c, 1), c[0][0] + x), tuple(arrays), arrays[how[0]]
            )
            arrays = [*arrays[:2], 0.5 * last]
    return tuple(arrays)


@pytest.mark.thorough
@settings(max_examples=25)
@given(steps(2), st.sampled_from([4, 70]), st.integers(0, 3))
def test_programs_agree(program, length, i):
    rng = np.random.default_rng(i)
    arrays = tuple(rng.uniform(-1, 1, length) for _ in range(3))

    def f(arrays, i):
        return follow(program, arrays, i)

    for found, expected in zip(native(f, arrays, i), jax.jit(f)(arrays, i), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@settings(max_examples=6)
@given(steps(1), st.sampled_from([4, 70]))
def test_their_derivatives_agree(program, length):
    arrays = tuple(np.random.default_rng(7).uniform(0.1, 1, length) for _ in range(3))

    def f(arrays):
        return sum(jnp.sum(array) for array in follow(program, arrays, 1))

    for found, expected in zip(native(jax.grad(f), arrays), jax.jit(jax.grad(f))(arrays), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
