"""Small programs drawn at random: expressions, loops, branches and slices, against XLA; also in lanes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from jax import lax

from jaxball.programs.native.ir import turns

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


def steps(depth, loops=("loop", "while")):
    """A step takes some arrays and gives as many: a list of such is a program.

    - ``loops``: of as many turns each time, or of another number, which reverse mode can't differentiate.
    """
    place = st.integers(0, 2)
    plain = st.one_of(
        st.tuples(st.just("unary"), st.integers(0, len(UNARY) - 1), place, place),
        st.tuples(st.just("binary"), st.integers(0, len(BINARY) - 1), place, place, place),
        st.tuples(st.just("set"), place, place, st.integers(-2, 9)),
        st.tuples(st.just("slice"), place, place),
        st.tuples(st.just("exchange"), place, place),
        st.tuples(st.just("drop"), place, place, st.integers(0, 200)),
    )
    if not depth:
        return st.lists(plain, min_size=1, max_size=4)
    inner = steps(depth - 1, loops)
    nested = st.one_of(
        plain,
        st.tuples(st.sampled_from(loops), place, st.integers(0, 3), inner),
        st.tuples(st.just("branch"), place, inner, inner),
        st.tuples(st.just("hand on"), place, st.booleans(), st.lists(place, min_size=2, max_size=2), inner),
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
        elif name == "drop":
            at = i + jnp.where(arrays[how[1]][1] > 0, how[2], 0)  # may lie outside
            arrays[how[0]] = arrays[how[0]].at[at].set(0.5 * arrays[how[1]][0], mode="drop")
        elif name == "loop":
            arrays = list(lax.fori_loop(0, how[1], lambda j, c, inner=how[2]: follow(inner, c, j), tuple(arrays)))
        elif name == "while":
            arrays = list(many_turns(how[2], arrays, how[1] + jnp.where(arrays[how[0]][0] > 0, 2, 0)))
        elif name == "hand on":
            arrays = handed_on(how, arrays, i)
        elif name == "branch":
            yes, no = (lambda c, inner=inner: follow(inner, c, i) for inner in how[1:])
            arrays = list(lax.cond(jnp.sum(arrays[how[0]]) > 0.3, yes, no, tuple(arrays)))
        else:
            arrays, last = lax.scan(
                lambda c, x, inner=how[1]: (follow(inner, c, 1), c[0][0] + x), tuple(arrays), arrays[how[0]]
            )
            arrays = [*arrays[:2], 0.5 * last]
    return tuple(arrays)


def many_turns(program, arrays, turns):
    """As many turns of a program as the numbers say."""
    return lax.while_loop(
        lambda c: c[0] < turns, lambda c: (c[0] + 1, follow(program, c[1], c[0])), (0, tuple(arrays))
    )[1]


def handed_on(how, arrays, i):
    """Two of three arrays, each what one branch makes of it or, in the other, one that is handed on as it was given."""
    which, first, given, program = how
    ways = [lambda: tuple(arrays[k] for k in given), lambda: follow(program, arrays, i)[:2]]
    given_back = lax.cond(jnp.sum(arrays[which]) > 0.3, *(ways if first else ways[::-1]))
    return [0.5 * (new + old) for new, old in zip(given_back, arrays[:2], strict=True)] + [arrays[2]]


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


@pytest.mark.thorough
@settings(max_examples=6)
@given(steps(1, ("loop",)), st.sampled_from([4, 70]))
def test_their_derivatives_agree(program, length):
    arrays = tuple(np.random.default_rng(7).uniform(0.1, 1, length) for _ in range(3))

    def f(arrays):
        return sum(jnp.sum(array) for array in follow(program, arrays, 1))

    for found, expected in zip(native(jax.grad(f), arrays), jax.jit(jax.grad(f))(arrays), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def in_lanes(program, length):
    """Asserts that compilers agree on a program of which each row is computed in a lane."""
    rows = tuple(np.random.default_rng(2).uniform(-1, 1, (19, length)) for _ in range(3))

    def f(rows):
        return lax.map(lambda arrays: follow(program, arrays, 1), rows)

    for found, expected in zip(native(f, rows), jax.jit(f)(rows), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)


@pytest.fixture(scope="module")
def everything_in_lanes():
    """Also what does not pay."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(turns, "LEAST_WORK", 0)
        yield


@pytest.mark.thorough
@settings(max_examples=20)
@given(steps(2), st.sampled_from([4, 70]))
def test_programs_agree_in_lanes(everything_in_lanes, program, length):
    in_lanes(program, length)


@pytest.mark.thorough
@settings(max_examples=6)
@given(steps(1), st.sampled_from([4, 70]))
def test_small_programs_agree_in_lanes(everything_in_lanes, program, length):
    in_lanes(program, length)


@pytest.mark.thorough
@settings(max_examples=6)
@given(steps(1), st.sampled_from([4, 70]))
def test_quick_code_gives_the_same_bits(everything_in_lanes, program, length):
    rows = tuple(np.random.default_rng(2).uniform(-1, 1, (19, length)) for _ in range(3))

    def f(rows):
        alone = follow(program, [array[0] for array in rows], 1)
        return alone, lax.map(lambda arrays: follow(program, arrays, 1), rows)

    quick, optimised = (jax.tree.leaves(native(f, rows, quickly=quickly)) for quickly in (True, False))
    assert [np.asarray(array).tobytes() for array in quick] == [np.asarray(array).tobytes() for array in optimised]
