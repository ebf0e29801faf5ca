"""Arrays whose first axis is kept in vectors, beside XLA; what is computed once before a loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.programs.native import Lowered

from .comparison import agree, native, special

rng = np.random.default_rng(5)
X, Y = rng.normal(size=(8, 9)), rng.normal(size=(8, 3))


def test_each_operation_of_lanes():
    """Special numbers in every lane, an operand that is the same in all, constants that differ from lane to lane."""
    numbers = np.resize(special(float), (8, 8))

    def f(x, y, a):
        other = jnp.roll(x, 1, axis=0)
        chosen = jnp.where((x > y) & ~(x == other), x + a, jnp.arange(8.0)[:, None] * y)
        return chosen, jnp.maximum(x, other), jnp.abs(x) - a, jnp.floor(x), x.astype(int) % 3, jnp.sqrt(jnp.abs(y))

    agree(f, numbers, numbers.T.copy(), 0.7)


def test_functions_of_the_library_by_lanes():
    agree(lambda x: (jnp.sin(x), jnp.exp(x), jnp.arctan2(x, 1 + x**2), jnp.cbrt(x)), X, ulps=8)


def test_reductions_keep_or_take_the_first_axis():
    A = rng.normal(size=(8, 8))

    def f(x):
        combined = jnp.sum(jnp.asarray(A)[:, :, None] * x[None], axis=1)
        return (
            combined,
            jnp.sum(x, axis=1),
            jnp.max(x, axis=0),
            jnp.argmin(x, axis=1),
            jnp.sum(x * x),
            x.ravel() @ x.ravel(),
        )

    agree(f, X, ulps=100)


@pytest.mark.thorough
@pytest.mark.parametrize("count", [3, 4, 6, 8, 11, 16])
def test_products_of_rows(count):
    rng = np.random.default_rng(5)
    x, y = rng.normal(size=(2, count, 9))
    A = rng.normal(size=(count, 2, 9))
    A[:, 0, 3:] = 0.0

    def f(x, y, A):
        inner = jax.vmap(jnp.vdot)(jnp.sin(x), y + 1)
        return inner, jax.vmap(jnp.matmul)(jnp.cos(A), x), jax.vmap(lambda x: jnp.vdot(x[:0], x[:0]))(x), inner[0]

    agree(f, x, y, A, ulps=64)
    numbers = np.arange(9 * count).reshape(count, 9) % 7 - 3
    for one, other in [(numbers, numbers), (numbers > 0, numbers < 2), (numbers + 1j, 2 * numbers - 1j)]:
        agree(jax.vmap(jnp.vdot), one, other)


@pytest.mark.thorough
@pytest.mark.parametrize("shape", [(5, 81), (10, 3, 10), (16, 5, 6)])
def test_rows_that_leave_the_vectors(shape):
    """An array is in registers for its first axis alone: a row of it, or its transpose, may be too long for that."""

    def f(x):
        x = jnp.sin(x)  # which is in registers
        positive = x > 0
        rows = (x[0], x[-1:], x[1:3], jnp.sum(x, 0), jnp.argmax(x, 0), jnp.all(positive, 0), jnp.cumsum(x, 0)[-1])
        moved = (jnp.swapaxes(x, 0, 1), x.reshape(-1), jnp.flip(x, 0), jnp.roll(x, 2, 1), jnp.concatenate([x, 2 * x]))
        chosen = jnp.take(x, jnp.argmax(x[:, 0].ravel()[0]), axis=0)
        products = jnp.einsum("i...,i...->...", x, x), x.reshape(shape[0], -1) @ jnp.ones(x[0].size)
        return (
            rows,
            moved,
            chosen,
            products,
            jnp.where(positive, x, x[0]),
            jnp.sort(x, axis=0),
            jnp.broadcast_to(x[0], x.shape),
        )

    agree(f, rng.normal(size=shape), ulps=600)


def test_lanes_move_to_other_places():
    def f(x):
        turned = jnp.roll(x, 1, axis=1) * x + 2.0 * jnp.flip(x, axis=1) ** 2
        return turned.T[:, ::-1] + 1.0, jnp.concatenate([turned, x], axis=1)[:, 2:5], turned.reshape(4, 6)[1] * 2

    agree(f, Y, ulps=4)


def test_a_mapped_field_in_a_loop_of_a_loop():
    """As the stages of an implicit method: carried from turn to turn, a norm decides how many there are."""

    def field(t, x):
        return jnp.stack([x[1] * t, -jnp.sin(x[0]), x[0] * x[1] - x[2]])

    def f(x):
        def improve(carry):
            x, _, count = carry
            new = 0.1 * jax.vmap(field)(jnp.linspace(0.0, 1.0, 8), x)
            return new, jnp.max(jnp.abs(new - x)), count + 1

        return jax.lax.while_loop(lambda c: (c[1] > 1e-12) & (c[2] < 40), improve, (x, jnp.inf, 0))

    agree(f, Y, ulps=50)


def text_of(f, *args):
    """The program of a function as LLVM's text."""
    return Lowered(lambda leaves: jax.tree.leaves(f(*leaves)), args, "f").as_text()


def test_lanes_are_taken_out_where_they_are_read_only():
    text = text_of(lambda x: jnp.sum(jnp.abs(x * 2.0 - 1.0), axis=1)[:3], X)
    assert text.count("extractelement") == 3
    assert "call <8 x double> @llvm.fma.v8f64(" in text


def test_products_and_sums_are_found_again_whichever_number_comes_first():
    def f(x, y, z):
        return x * y, y * x, x + y, y + x, x * y + z, z + y * x

    text = text_of(f, 0.3, 0.1, 0.2)
    assert [text.count(f"= {written}") for written in ("fmul ", "fadd ", "call double @llvm.fma.f64(")] == [1, 1, 1]
    agree(f, 0.3, 0.1, 0.2, ulps=1)


def test_known_products_that_are_0_are_left_out_of_sums():
    def f(x):
        return jnp.dot(jnp.concatenate([x, jnp.zeros(2)]), jnp.asarray([1.0, -2.0, 3.0, 4.0, 5.0]))

    x = jnp.asarray([0.1, 0.2, 0.4])
    assert "fadd" not in text_of(f, x)
    agree(f, x, ulps=2)
    assert native(lambda x: jnp.dot(jnp.zeros(3), jnp.zeros(3)) + 0 * x[0], x) == 0


def test_what_does_not_change_is_computed_before_the_loops():
    def f(x, y):
        def inner(_, carry):
            return carry * jnp.sqrt(y) + jnp.exp(x)

        return jax.lax.fori_loop(0, 50, lambda _, c: jax.lax.fori_loop(0, 3, inner, c), x + y)

    text = text_of(f, 0.3, 0.1)
    for instruction in ("@llvm.sqrt.f64(double", "@llvm.exp.f64(double"):
        place = text.index(f"call double {instruction}")
        assert text.index("define internal void @main") < place < text.index("\nwhile.")
    agree(f, 0.3, 0.1, ulps=200)


def test_what_differs_from_turn_to_turn_of_an_outer_loop_is_computed_in_it():
    """Also what a loop has left behind, and what stands in a branch."""

    def f(x):
        def outer(k, carry):
            a = jax.lax.fori_loop(0, 3, lambda i, c: c + jnp.sin(c) * i, carry + k)
            b = jax.lax.fori_loop(0, 4, lambda i, c: c + jnp.cos(a) * i, carry)
            return 0.1 * jax.lax.cond(b > a, lambda: jax.lax.fori_loop(0, 2, lambda i, c: c + a * b, b), lambda: a * b)

        return jax.lax.fori_loop(0, 6, outer, x)

    agree(f, 0.3, ulps=500)


def test_a_division_that_is_not_executed_may_stand_before_the_loop():
    def f(n, d):
        return jax.lax.fori_loop(0, n, lambda i, c: c + jax.lax.cond(d != 0, lambda: n // d, lambda: i), 0)

    assert native(f, 3, 0) == 3
    agree(f, 3, 2)


def stages(x, first=0, last=6):
    """A table filled row by row, each of all before, as the stages of an explicit method."""

    def add(carry):
        i, table = carry
        row = jnp.sin(x + jnp.asarray(A)[i] @ table)
        return i + 1, table.at[i].set(row)

    A = np.tril(np.random.default_rng(3).normal(size=(6, 6)), -1)
    return jax.lax.while_loop(lambda carry: carry[0] < last, add, (first, jnp.zeros((6, 15))))[1]


def test_a_short_loop_is_written_out():
    x = rng.normal(size=15)
    assert "\nwhile." not in text_of(stages, x)
    agree(stages, x, ulps=100)


def test_a_loop_from_or_to_what_is_not_known_is_a_loop():
    x = rng.normal(size=15)
    for ends in ((1, 6), (0, 4), (3, 3), (5, 2)):
        assert "\nwhile." in text_of(stages, x, *ends)
        agree(stages, x, *ends, ulps=100)


def test_short_loops_of_several_ends():
    """Of two counters the one that ends first decides; one that ends by something else as well is a loop."""

    def f(x):
        both = jax.lax.while_loop(
            lambda c: (c[0] < 7) & (c[1] < 9), lambda c: (c[0] + 1, c[1] + 2, c[2] * x), (0, 0, 1.0)
        )
        either = jax.lax.while_loop(lambda c: (c[0] < 7) & (c[1] < 4.0), lambda c: (c[0] + 1, c[1] * x), (0, 1.0))
        none = jax.lax.while_loop(lambda c: c[0] < 7, lambda c: (c[0] + 1, c[1] * x), (7, 1.0))
        swapped = jax.lax.fori_loop(0, 3, lambda i, c: (c[1], c[0] + i), (x, 2.0))
        return both, either, none, swapped

    agree(f, 1.5, ulps=4)


def test_a_table_that_is_kept_as_it_was_before_a_short_loop():
    def f(table):
        filled = jax.lax.fori_loop(0, 4, lambda i, t: t.at[i].set(t[i + 1] * 2.0), table)
        return filled, table + filled, jax.lax.fori_loop(0, 4, lambda i, t: t.at[i].add(filled[i]), table)

    agree(f, rng.normal(size=(8, 20)), ulps=2)


@pytest.mark.thorough
@pytest.mark.parametrize("count", [5, 6, 7, 9, 12, 13, 16])
def test_a_first_axis_that_does_not_fill_its_vectors(count):
    """Carried by a loop, chosen by a branch, in another order of the lanes, and combined over the first axis."""
    columns = 9 if count < 9 else 5
    A = rng.normal(size=(count, count)) / count
    order = np.roll(np.arange(count), 2)

    def f(x, y):
        def turn(k, carry):
            x, y = carry
            new = jnp.sum(jnp.asarray(A)[:, :, None] * jnp.tanh(x)[None], axis=1) + y[order]
            return new, jax.lax.cond(jnp.sum(new) > 0, lambda: 0.5 * y, lambda: x - y)

        x, y = jax.lax.fori_loop(0, 30, turn, (x, y))
        return x, y, jnp.argmax(jnp.abs(x), axis=1), x[count - 1]

    agree(f, rng.normal(size=(count, columns)), rng.normal(size=(count, columns)), ulps=1e5)


@pytest.mark.thorough
@pytest.mark.parametrize("count", [8, 9, 10, 17])
def test_tangents_in_many_directions(count):
    """Of vectors and matrices within a loop and a function of its own."""

    @jax.jit
    def field(x, numbers):
        R = jnp.cos(x[:, None] - x[None]) * numbers[:3, None]
        return jnp.sum(R * jnp.sin(x)[None], axis=1) + numbers[3] * jnp.cross(jnp.sin(x), jnp.cos(R[0]))

    def end(numbers):
        return jax.lax.fori_loop(0, 4, lambda k, x: x + 0.1 * field(x, numbers), jnp.asarray([0.3, -0.2, 0.5]))

    def spread(numbers):
        return end(numbers[:4] + jnp.mean(jnp.sin(numbers[4:])))

    agree(jax.jacfwd(spread), np.linspace(0.1, 0.9, count), ulps=200)
