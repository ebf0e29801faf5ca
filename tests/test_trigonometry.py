"""Sine and cosine against 40-digit arithmetic."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

from jaxball.numerics.vectors import HALF_PI, sine_cosine


def worst(x):
    mpmath.mp.dps = 40
    sine, cosine = (np.asarray(values) for values in jax.jit(sine_cosine)(jnp.asarray(x)))
    exact = [(mpmath.sin(mpmath.mpf(float(a))), mpmath.cos(mpmath.mpf(float(a)))) for a in x]
    errors = [
        max(abs(mpmath.mpf(float(s)) - es), abs(mpmath.mpf(float(c)) - ec))
        for s, c, (es, ec) in zip(sine, cosine, exact, strict=True)
    ]
    return float(max(errors))


@pytest.mark.parametrize("size", [1.0, 10.0, 1e3, 1e6])
def test_error_is_two_units_of_1e16_at_most(size):
    x = np.random.default_rng(1).uniform(-size, size, 2000)
    assert worst(x) <= 2e-16


def test_multiples_of_a_quarter_turn():
    x = np.concatenate([np.pi / 4 * np.arange(-40, 41), np.nextafter(np.pi / 4 * np.arange(-40, 41), 99)])
    assert worst(x) <= 2e-16


def test_the_parts_of_half_pi_add_up_and_multiply_exactly():
    mpmath.mp.dps = 60
    total = sum(mpmath.mpf(part) for part in HALF_PI)
    assert abs(total - mpmath.pi / 2) < 1e-36
    for part in HALF_PI[:2]:
        numerator = Fraction(part).numerator
        assert numerator.bit_length() <= 33


def test_derivatives_of_any_order_stay_sines():
    def sine(x):
        return sine_cosine(x)[0]

    x = jnp.asarray(1.3)
    assert jax.grad(sine)(x) == pytest.approx(np.cos(1.3), abs=2e-16)
    assert jax.jvp(jax.grad(sine), (x,), (jnp.ones(()),))[1] == pytest.approx(-np.sin(1.3), abs=2e-16)


def test_what_is_not_finite_stays_so():
    for values in sine_cosine(jnp.asarray([jnp.inf, -jnp.inf, jnp.nan])):
        assert bool(jnp.all(jnp.isnan(values)))


def test_float32_uses_the_library():
    x = jnp.linspace(-3, 3, 7, dtype=jnp.float32)
    sine, cosine = sine_cosine(x)
    assert sine.dtype == cosine.dtype == jnp.float32
    np.testing.assert_allclose(sine, np.sin(x), atol=2e-7)
    np.testing.assert_allclose(cosine, np.cos(x), atol=2e-7)
