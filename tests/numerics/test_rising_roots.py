"""Roots of a rising function, against closed forms: which one is found, how exactly, and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.numerics.roots import find_rising_root, with_derivatives_of_root


def cubed(x, a):
    return x**3 - a


def root_of_cube(a):
    """The cube root, without its closed form."""
    x = find_rising_root(cubed, jnp.ones_like(a), -jnp.inf, jnp.zeros_like(a), a)
    return with_derivatives_of_root(x, cubed, a)


@pytest.mark.parametrize("a", [8.0, 1e-9, 1e12, -27.0])
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivatives_of_a_cube_root(a, mode):
    """Up to the fourth, each of which is the one before times (1/3 − k)/a."""
    function, expected, a = root_of_cube, np.cbrt(a), jnp.array(a)
    for k in range(5):
        np.testing.assert_allclose(jaxball.jit(function)(a), expected, rtol=1e-13)
        function, expected = mode(function), expected * (1 / 3 - k) / a


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("turns", [-2, 0, 1])
@pytest.mark.parametrize("share", [-0.15, 0.0, 0.1])
def test_the_root_next_to_the_guess(size, turns, share):
    """A sine of any slope rises at whole periods; so near to one of them, steps of Newton's method stay there."""
    guess, one = jnp.array(turns + share), jnp.array(1.0)
    x = find_rising_root(lambda x: size * jnp.sin(2 * jnp.pi * x), guess, -jnp.inf, one)
    np.testing.assert_allclose(x, turns, atol=1e-14)


def test_roots_at_which_the_function_falls_are_not_roots():
    """1 − x² falls at 1 and rises at −1; x² + 1 and −1 have none; from above 0, x² − 1 rises at 1."""
    one = jnp.array(1.0)
    for guess in (-3.0, -0.5, 0.0, 0.5, 1.0):
        np.testing.assert_allclose(
            find_rising_root(lambda x: 1 - x**2, jnp.array(guess), -jnp.inf, one), -1, rtol=1e-14
        )
        assert jnp.isnan(find_rising_root(lambda x: x**2 + 1, jnp.array(guess), -jnp.inf, one))
        assert jnp.isnan(find_rising_root(lambda x: 0 * x - 1, jnp.array(guess), -jnp.inf, one))
    for guess in (1e-3, 0.5, 1.0, 700.0):
        np.testing.assert_allclose(find_rising_root(lambda x: x**2 - 1, jnp.array(guess), 0.0, one), 1.0, rtol=1e-14)


def test_derivatives_by_what_a_function_has_captured():
    """d∛a/da where the function holds a itself, in both modes."""

    def root(a):
        def cubed(x):
            return x**3 - a

        return with_derivatives_of_root(find_rising_root(cubed, jnp.ones_like(a), -jnp.inf, jnp.ones_like(a)), cubed)

    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(mode(root)(jnp.array(8.0)), 1 / 12, rtol=1e-14)
