"""Zeros along a flow, and derivatives for results found without them, against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.numerics.calculus import move_to_peak, move_to_zero, rates_along, with_derivatives, with_second_derivatives
from jaxball.numerics.directions import diverging
from tests.support.sentences import refuses

HESSIANS = {"forward over forward": lambda f: jax.jacfwd(jax.jacfwd(f)), "forward over reverse": jax.hessian}


def oscillator(omega):
    def field(t, state):
        x, v, turns = state
        return v, -(omega**2) * x, jnp.zeros_like(turns)

    return field


def height(t, state):
    return state[0] - jnp.sin(t)


@pytest.mark.parametrize("twice", list(HESSIANS.values()), ids=list(HESSIANS))
def test_a_zero_along_a_flow_has_second_derivatives(twice):
    """x cos ωs + v/ω sin ωs = sin (t + s) at s = 0: by x, v, t and ω, from the implicit function theorem twice."""

    def at_zero(p):
        x, v, t, omega = p
        state, field = (x, v, jnp.asarray(3)), oscillator(omega)
        slope = jax.lax.stop_gradient(rates_along(height, t, state, field(t, state))[1])
        t, (x, v, turns) = move_to_zero(field, height, t, state, slope, jnp.zeros_like(t))
        return jnp.stack([t, x, v]), turns

    def by_newton(p):  # ten steps of Newton's method on the closed form, which gain orders of the derivatives
        x, v, t, omega = p

        def moved(s):
            c, d = jnp.cos(omega * s), jnp.sin(omega * s)
            return jnp.stack([t + s, x * c + v / omega * d, v * c - omega * x * d])

        s = jnp.zeros_like(t)
        for _ in range(10):
            s = s - (moved(s)[1] - jnp.sin(t + s)) / (moved(s)[2] - jnp.cos(t + s))
        return moved(s)

    p = jnp.array([jnp.sin(0.7), -0.4, 0.7, 1.3])
    (place, turns), expected = at_zero(p), by_newton(p)
    assert turns == 3
    np.testing.assert_allclose(place, expected, rtol=1e-15)
    np.testing.assert_allclose(twice(lambda p: at_zero(p)[0])(p), twice(by_newton)(p), rtol=0, atol=1e-13)


@pytest.mark.parametrize("twice", list(HESSIANS.values()), ids=list(HESSIANS))
def test_a_peak_along_a_flow_has_second_derivatives(twice):
    """x is at most √(x² + v²/ω²), where v = 0; where a step ends before, it is largest there, and stays."""

    def largest(p, length):
        x, v, omega = p
        state, zero = (x, v, jnp.asarray(3)), jnp.zeros_like(x)
        return move_to_peak(oscillator(omega), lambda t, state: state[0], zero, state, jnp.asarray(length))[1][0]

    p, others = jnp.array([0.8, 0.0, 1.3]), jnp.array([0.8, 0.5, 1.3])
    # The second derivatives by v and by v and ω are 1/(x ω²) and 0: at v = 0 the root is smooth.
    expected = twice(lambda p: jnp.sqrt(p[0] ** 2 + (p[1] / p[2]) ** 2))(p)
    np.testing.assert_allclose(twice(lambda p: largest(p, 1.0))(p), expected, rtol=0, atol=1e-13)
    for place, length in ((p, 0.0), (others, 1.0)):
        np.testing.assert_array_equal(twice(lambda p, length=length: largest(p, length))(place), np.zeros((3, 3)))


def test_derivatives_have_rows_where_a_value_has_none():
    """Of the value 1, which is that of sin a / sin a₀ at a₀: cot a by a, and −1 twice."""

    @jax.jit
    def part(a):
        def whole(a):
            return jnp.sin(a) / jax.lax.stop_gradient(jnp.sin(a))

        return with_second_derivatives(with_derivatives(jnp.ones(()), whole, a), "a test", whole, a)

    def along(function):
        return lambda rows: jax.jvp(function, (rows,), (jnp.ones_like(rows),))[1]

    rows = jnp.array([0.1, 0.2, 0.3])
    first = along(jax.vmap(part))
    np.testing.assert_allclose(first(rows), 1 / jnp.tan(rows), rtol=1e-15)
    np.testing.assert_allclose(along(first)(rows), -np.ones(3), rtol=1e-15)
    with refuses(TypeError):
        along(along(first))(rows)


def test_first_and_second_derivatives_may_come_from_different_functions():
    """Those of 2a x and of 2a x + x² + x³ are the same at x = 0 up to the first, and 2 by x and a; by x twice the
    latter has 2.
    """

    def whole(x, a):
        return {"value": x**3 + x**2 + 2 * a * x, "count": jnp.asarray(1)}

    def part(p):
        x, a = p
        value = {"value": 2 * a * x, "count": jnp.asarray(1)}
        return with_second_derivatives(value, "a test", whole, x, a)["value"]

    p = jnp.array([0.0, 2.0])
    np.testing.assert_array_equal(jax.grad(part)(p), [4.0, 0.0])
    np.testing.assert_array_equal(jax.jacfwd(part)(p), [4.0, 0.0])
    for around in (lambda f: f, jax.jit, jaxball.jit):
        np.testing.assert_array_equal(around(jax.jacfwd(jax.jacfwd(part)))(p), [[2.0, 2.0], [2.0, 0.0]])
    with refuses(TypeError):
        jax.jacfwd(jax.jacfwd(jax.jacfwd(part)))(p)


def test_a_function_is_evaluated_only_for_second_derivatives():
    """By what it has captured, too."""
    calls = []

    def part(p):
        def whole(x):
            calls.append(x)
            return x * p[1] ** 2

        return with_second_derivatives(p[0] * p[1] ** 2, "a test", whole, p[0])

    p = jnp.array([3.0, 2.0])
    np.testing.assert_array_equal([jax.jit(part)(p), *jax.jit(jax.jacfwd(part))(p)], [12.0, 4.0, 12.0])
    assert not calls
    np.testing.assert_array_equal(jax.jacfwd(jax.jacfwd(part))(p), [[0.0, 4.0], [4.0, 6.0]])
    assert calls


def test_a_direction_has_second_derivatives():
    """b + M σ points along σ = (cos φ, sin φ): tan φ as the root of a quadratic where M is diagonal and b along e1."""

    def pull(about, sigma):
        b, M = about
        return b + M @ sigma, jnp.ones(())

    def searched(p):
        return diverging(pull, (jnp.array([0.5, 0.2]) * p[0], jnp.diag(p[1:])), jnp.array([1.0, 0.3])).sigma

    def by_newton(p):
        b, (m1, m2), angle = jnp.array([0.5, 0.2]) * p[0], p[1:], jnp.arctan2(*searched(p)[::-1])
        angle = jax.lax.stop_gradient(angle)
        for _ in range(6):
            c, s = jnp.cos(angle), jnp.sin(angle)
            across = c * (b[1] + m2 * s) - s * (b[0] + m1 * c)
            angle = angle - across / (-s * (b[1] + m2 * s) + c * m2 * c - c * (b[0] + m1 * c) + s * m1 * s)
        return jnp.stack([jnp.cos(angle), jnp.sin(angle)])

    p = jnp.array([1.0, 0.6, 0.4])
    np.testing.assert_allclose(jax.jacfwd(searched)(p), jax.jacfwd(by_newton)(p), rtol=0, atol=1e-14)
    twice = HESSIANS["forward over forward"]
    np.testing.assert_allclose(twice(searched)(p), twice(by_newton)(p), rtol=0, atol=1e-13)
