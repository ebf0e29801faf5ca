"""Loops that are differentiated in reverse mode by going back over their steps, against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.programs.derivatives.reverse_rules import PullByForwardMode, put, put_while
from jaxball.programs.derivatives.reversible_loop import Parts, Recorded, while_loop

STEPS, ROOM = 11, 16


def powers(x, n, rows=None, reverse=True):
    """x**n as it grows, and that of every step, by a loop of n steps with room for more."""

    def unfinished(carry):
        return carry[0] < n

    def advance(carry, counts):
        k, y, seen, odd = carry
        return k + 1, y * x, put(seen, k, y, counts), ~odd

    start = jnp.asarray(0), jnp.ones_like(x), jnp.zeros(ROOM), jnp.asarray(False)
    loop = while_loop(
        unfinished, advance, start, max_steps=ROOM, buffers=lambda carry: carry[2], reverse=reverse, rows=rows
    )
    return loop[1], loop[2]


def derivatives_of_powers(x, n):
    k = np.arange(ROOM)
    return n * x ** (n - 1), np.where(k < n, k * x ** np.maximum(k - 1.0, 0.0), 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize("rows", [None, 1, 2, 3, 5, 11, 16])
def test_steps_without_a_row_are_taken_again(rows):
    derivatives = jax.jit(jax.jacrev(lambda x, n: powers(x, n, rows)))
    for n in (0, 1, 2, 7, STEPS, ROOM):
        for one, other in zip(derivatives(jnp.asarray(1.1), n), derivatives_of_powers(1.1, n), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-14)  # a product of up to 16 factors


def test_natively_as_by_xla():
    def both(x):
        return jax.jacrev(lambda x: powers(x, STEPS, 4))(x)

    for one, other in zip(jaxball.jit(both)(1.1), jax.jit(both)(1.1), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-15)


def test_forward_mode():
    found = jax.jit(jax.jacfwd(lambda x: powers(x, STEPS, reverse=False)))(jnp.asarray(1.1))
    for one, other in zip(found, derivatives_of_powers(1.1, STEPS), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14)


@pytest.mark.thorough
@pytest.mark.parametrize("rows", [None, 3])
def test_in_a_batch_each_has_steps_of_its_own(rows):
    n = jnp.array([3, 0, 16, 7])
    found = jax.vmap(jax.jacrev(lambda x, n: powers(x, n, rows)), in_axes=(None, 0))(jnp.asarray(1.1), n)
    for k, count in enumerate(n):
        for one, other in zip(found, derivatives_of_powers(1.1, int(count)), strict=True):
            np.testing.assert_allclose(one[k], other, rtol=1e-14)


def test_more_steps_than_there_may_be_are_not_taken():
    assert powers(jnp.asarray(2.0), 100)[0] == 2.0**ROOM


@pytest.mark.thorough
@pytest.mark.parametrize("reverse", [False, True])
def test_rows_of_a_series(reverse):
    """sin(k x) for all k below n, of a batch of n."""

    def rows(x, n):
        empty, first = jnp.zeros(8), jnp.asarray(2)
        return put_while(lambda k: k < n, lambda k: jnp.sin(k.astype(float) * x), empty, first, reverse=reverse)[0]

    x, n, k = 0.3, np.array([2, 5, 8]), np.arange(8)
    counts = (k >= 2) & (k < n[:, None])
    values = jax.vmap(rows, in_axes=(None, 0))(x, n)
    np.testing.assert_allclose(values, np.where(counts, np.sin(k * x), 0.0), rtol=1e-15)
    derivative = (jax.jacrev if reverse else jax.jacfwd)(rows)
    slopes = jax.vmap(derivative, in_axes=(None, 0))(x, n)
    np.testing.assert_allclose(slopes, np.where(counts, k * np.cos(k * x), 0.0), rtol=1e-15)


def recorded_powers(a, b, carried_out):
    """The value after steps y ← y (a + b), of which the product is recorded."""

    def advance(carry, counts):
        k, y = carry

        def product(operands):
            carried_out.append("forward")
            y, parameters = operands
            return [y * jnp.sum(parameters)]

        def pull(known, cotangents, varies):
            (y, parameters), _ = known
            assert varies[0] is True
            carried_out.append([bool(varying) for varying in varies[1]])
            of_parameters = [y * cotangents[0] if varying else None for varying in varies[1]]
            return sum(parameters) * cotangents[0], of_parameters

        (y,) = recorded(product, pull, (y, parameters))
        return k + 1, y

    recorded, parts = Recorded("product"), [a, b]
    parameters = jnp.stack(parts)
    return while_loop(
        lambda carry: carry[0] < STEPS,
        advance,
        (jnp.asarray(0), jnp.asarray(1.0)),
        max_steps=ROOM,
        buffers=lambda carry: (),
        reverse=True,
        recorded=[recorded],
        parts=Parts(parameters, parts, jnp.stack),
    )[1]


def test_a_recorded_part_is_only_pulled_back_and_to_what_varies():
    carried_out = []
    found = jax.jit(jax.grad(lambda a: recorded_powers(a, jnp.asarray(0.5), carried_out)))(jnp.asarray(0.6))
    np.testing.assert_allclose(found, STEPS * 1.1 ** (STEPS - 1), rtol=1e-14)
    assert carried_out == ["forward", [True, False]]  # each traced once


def test_parts_with_loops_of_any_length_are_pulled_back_by_forward_mode():
    """A step multiplies by x as often as it says, by one recorded part, and by y once, by another."""
    often, once = Recorded("often"), Recorded("once")

    def product(given):
        value, factor, times = given
        turn = jax.lax.while_loop(lambda at: at[0] < times, lambda at: (at[0] + 1, at[1] * factor), (0, value))
        return [turn[1], times]

    def end(x, y):
        def advance(carry, counts):
            k, value = carry
            value, times = often(product, PullByForwardMode(product), (value, x, k))
            value, _ = once(product, PullByForwardMode(product), (value, y, jnp.ones_like(k)))
            return times + 1, value

        start = jnp.asarray(0), jnp.asarray(1.0)
        loop = {"max_steps": ROOM, "buffers": lambda carry: (), "reverse": True, "recorded": [often, once]}
        return while_loop(lambda carry: carry[0] < STEPS, advance, start, **loop)[1]

    turns = STEPS * (STEPS - 1) // 2
    x, y = 1.02, 0.9
    found = jax.jit(jax.grad(end, argnums=(0, 1)))(jnp.asarray(x), jnp.asarray(y))
    expected = turns * x ** (turns - 1) * y**STEPS, STEPS * x**turns * y ** (STEPS - 1)
    np.testing.assert_allclose(found, expected, rtol=1e-13)  # of products of 66 factors
