"""Loops, branches and functions: what is carried, and what may be overwritten."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxball.programs.native import Lowered
from jaxball.programs.native.emit.operations import loops
from jaxball.programs.native.ir import turns

from .comparison import agree

LENGTHS = [3, 100]


def numbers(length):
    return np.random.default_rng(6).normal(size=length)


@pytest.mark.parametrize("length", LENGTHS)
def test_carries_that_change_places(length):
    def turned(x):
        return lax.fori_loop(0, 5, lambda i, c: (c[1], c[2] + 1, c[0], c[3]), (x, 2 * x, 3 * x, x[0]))

    agree(turned, numbers(length))


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("turns", [0, 1, 7])
def test_one_array_carried_twice(length, turns):
    def loop(x, turns):
        y = x + 1
        return lax.while_loop(lambda c: c[0] < turns, lambda c: (c[0] + 1, c[1].at[0].add(1.0), c[2] * 2), (0, y, y))

    agree(loop, numbers(length), turns)


@pytest.mark.parametrize("length", LENGTHS)
def test_what_is_read_after_the_loop_as_well(length):
    def loop(x):
        y = x * 2
        z = lax.fori_loop(0, 4, lambda i, z: z.at[i % 3].set(i * 1.0) + y[::-1], y)
        return y, z, x

    agree(loop, numbers(length))


@pytest.mark.parametrize("length", LENGTHS)
def test_reversed_in_each_turn(length):
    """What is read in another order than it is written."""
    agree(lambda x: lax.fori_loop(0, 3, lambda i, x: 0.5 * x[::-1] + x, x), numbers(length))


@pytest.mark.parametrize("dtype", ["float32", "int8", "bool", "complex128"])
@pytest.mark.parametrize("length", LENGTHS)
def test_types_of_carries(dtype, length):
    x = numbers(length).astype(dtype)
    agree(
        lambda x: lax.fori_loop(
            0,
            3,
            lambda i, c: (c[1], jnp.where(i == 1, c[0], c[0] & c[1] if dtype == "bool" else c[0] + c[1])),
            (x, x[::-1]),
        ),
        x,
    )


def test_nested_loops():
    def inner(i, x):
        return lax.while_loop(
            lambda c: jnp.sum(c[1]) < 40.0, lambda c: (c[0] + 1, c[1].at[c[0] % 100].add(i * 1.0)), (i, x)
        )[1]

    agree(lambda x: lax.fori_loop(1, 6, inner, x), np.abs(numbers(100)) / 10)


@pytest.mark.parametrize("length", LENGTHS)
def test_scans(length):
    def f(x):
        step = lambda carry, x: (carry * 0.5 + x, (carry, x > 0))  # noqa: E731
        return lax.scan(step, 0.0, x), lax.scan(step, 1.0, x, reverse=True), lax.map(jnp.sin, x)

    agree(f, numbers(length), ulps=8)
    agree(jax.grad(lambda x: jnp.sum(f(x)[0][1][0] ** 2)), numbers(length), ulps=1000)


@pytest.mark.thorough
@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("which", [-3, 0, 1, 2, 9])
def test_branches(length, which):
    branches = [lambda x, y: (x, y), lambda x, y: (y, x), lambda x, y: (x.at[1].set(5.0), x + y)]

    def f(which, x):
        return lax.switch(which, branches, x * 2, x + 1)

    agree(f, which, numbers(length))
    agree(lambda c, x: lax.cond(c, lambda x: x.at[0].set(1.0), lambda x: x, x * 2), which > 0, numbers(length))


@pytest.mark.parametrize("length", LENGTHS)
def test_branches_that_overwrite(length):
    """What is written in one branch is not seen in another, nor by what reads it later."""

    def f(n, x):
        def body(i, carry):
            x, y = carry
            x = lax.cond(i % 2 == 0, lambda x: x.at[i].add(10.0), lambda x: x, x)
            z = lax.cond(i % 3 == 0, lambda x: x.at[0].set(0.0), lambda x: x.at[1].set(0.0), x)
            return x, y + z

        return lax.fori_loop(0, n, body, (x * 1, x * 0))

    agree(f, 3, numbers(length))


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("which", [0, 1, 2])
def test_what_a_branch_hands_on_and_is_read_after_it(length, which):
    """Where one branch hands an array on, once or twice, another one does not write what it gives into that array."""

    def f(which, x):
        y = jnp.sort(x)
        return lax.switch(which, [lambda: (y, y), lambda: (2 * y, y + 1), lambda: (y[::-1], y)]), 3 * y

    agree(f, which, numbers(length))


@pytest.mark.parametrize("overwrites", [True, False])
@pytest.mark.parametrize("first", [True, False])
def test_what_is_made_of_an_array_that_one_branch_overwrites(overwrites, first):
    """It is not first computed in that branch, and read after it."""

    def f(overwrites, x):
        y = jnp.sort(x)
        back = y[::-1]  # nothing that is computed at once
        ways = [lambda: y.at[3].set(7.0), lambda: 2 * x]
        return lax.cond(overwrites == first, *(ways if first else ways[::-1])), 3 * back

    agree(f, overwrites, numbers(100))


def test_branches_in_a_batch():
    agree(jax.vmap(lambda c, x: lax.cond(c, jnp.sin, jnp.cos, x)), numbers(30) > 0, numbers(30), ulps=4)
    condition = lambda c: c[1] < 9.0  # noqa: E731
    agree(jax.vmap(lambda x: lax.while_loop(condition, lambda c: (c[0] + 1, c[1] * 2), (0, x))), np.abs(numbers(30)))


@pytest.mark.thorough
@pytest.mark.parametrize("length", LENGTHS)
def test_functions_that_stay_functions(length):
    """More operations than are written where they are called; nothing cancels, so that each adds a rounding or two."""

    @jax.jit
    def long(x, y, k):
        for i in range(90):
            x = jnp.where(x > k, x * 0.9 + y[i % 3], x + 0.1 * y[::-1])
        return x, y + x[0], jnp.sum(x.astype(complex)), x > 0

    def f(x):
        first = long(x, 2 * x, 0.3)
        second = long(*first[:2], x[0])
        third = long(*second[:2], 0.1)
        return first, second, third

    agree(f, np.abs(numbers(length)), ulps=3 * 90 * 2)


@pytest.mark.thorough
def test_functions_that_are_passed_vectors():
    """Rows that are passed in vectors, and read one by one in the function, and so are those that it returns."""

    @jax.jit
    def turned(x):
        for k in range(240):
            x = x.at[k % 8, k % 2].set(jnp.sin(x[(k + 1) % 8, 1]) * x[k % 8, 0])
        return x

    def twice(x):
        y = turned(turned(x) + x)
        return y, y[3, 1] * y[5, 0]

    agree(twice, numbers(16).reshape(8, 2))


def test_a_loop_within_a_function():
    @jax.jit
    def many(x, n):
        for i in range(80):
            x = x.at[i].add(x[i + 1] * 0.1)
            x = lax.cond(x[0] > i, lambda x: x * 0.5, lambda x: x, x)
        return lax.while_loop(lambda c: c[0] < n, lambda c: (c[0] + 1, c[1] * 1.01), (0, x))[1]

    agree(lambda x: (many(many(x, 3), 4), many(x, 1)), numbers(100), ulps=100)


def test_a_loop_of_calls_of_a_long_function_is_not_written_out():
    """Its body is one operation, a call; what is called counts."""

    @jax.jit
    def long(x):
        for k in range(300):
            x = jnp.sin(x) + 0.01 * k
        return x

    def f(x):
        return lax.scan(lambda x, _: (long(x), None), x, None, length=8)[0]

    text = Lowered(lambda leaves: [f(*leaves)], [numbers(2)], "f").as_text()
    assert text.count("call double @llvm.sin.f64") == 600
    agree(f, numbers(2), ulps=2000)


@pytest.mark.parametrize(("dtype", "step", "limit"), [("int8", 100, 120), ("uint8", 100, 251), ("int32", 3, 10)])
def test_a_counter_that_passes_the_last_integer_of_its_type_goes_on_with_the_first(dtype, step, limit):
    bounds, count = np.iinfo(dtype), 0
    while count < limit:
        count = (count + step - bounds.min) % (bounds.max - bounds.min + 1) + bounds.min
    step, limit = np.array(step, dtype), np.array(limit, dtype)
    found = agree(lambda: lax.while_loop(lambda i: i < limit, lambda i: i + step, jnp.zeros((), dtype)))
    assert found == count


def test_a_program_has_the_same_text_whenever_it_is_compiled():
    """Memory that several results leave at once is used again in the same order, whatever their addresses in Python."""

    def f(arrays):
        def turn(carried):
            k, arrays = carried
            return k + 1, [*(0.5 * jnp.sort(x) for x in arrays[1:]), jnp.sort(arrays[0])]

        _, arrays = lax.while_loop(lambda carried: carried[0] < jnp.sum(carried[1][0]), turn, (0, arrays))
        return [jnp.sort(x[::-1]) for x in arrays]

    assert len({Lowered(f, [numbers(200)] * 5, "f").as_text() for _ in range(4)}) == 1


def polynomial(x):
    return functools.reduce(lambda value, k: value * x + k, range(20), x)


@pytest.mark.parametrize(("f", "pays"), [(jnp.flip, False), (polynomial, True)])
def test_a_loop_is_computed_in_lanes_where_it_does_more_than_move_numbers(f, pays, monkeypatch):
    found = []

    def noted(*arguments):
        found.append(turns.independent(*arguments))
        return found[-1]

    monkeypatch.setattr(loops, "independent", noted)
    agree(lambda x: lax.map(f, x), numbers((24, 3)), ulps=200)  # a product and a sum are rounded once or twice
    assert (found[0] is not None) == pays
