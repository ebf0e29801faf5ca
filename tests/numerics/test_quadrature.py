"""Integrals by samples: exact for polynomials between kinks, and of the sixth order for others, compared with SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

from jaxball.numerics.quadrature import integrate_samples

NONE = jnp.zeros(0)
integrate = jax.jit(integrate_samples)


@pytest.mark.parametrize("count", [2, 3, 5, 6, 7, 20])
def test_polynomials_are_integrated_exactly_at_any_times(count):
    rng = np.random.default_rng(count)
    times = np.sort(rng.uniform(0.0, 1.0, count))
    polynomial = np.polynomial.Polynomial(rng.normal(size=min(6, count)))
    exact = polynomial.integ()(times[-1]) - polynomial.integ()(times[0])
    found = integrate(jnp.asarray(times), jnp.asarray(polynomial(times))[:, None], NONE)[0]
    np.testing.assert_allclose(found, exact, rtol=1e-10, atol=1e-12)


def test_the_order_is_six():
    exact = scipy.integrate.quad(lambda t: np.exp(np.sin(t)), 0.0, 5.0, epsabs=0, epsrel=1e-13)[0]
    errors = []
    for count in (41, 81):
        times = jnp.linspace(0.0, 5.0, count)
        errors.append(abs(float(integrate(times, jnp.exp(jnp.sin(times))[:, None], NONE)[0]) - exact))
    assert errors[0] < 1e-6  # the trapezoidal rule: 1e-3
    assert errors[1] < errors[0] / 2**6


@pytest.mark.parametrize("kink", [2.5, 1.7321, 4.9])
def test_a_jump_is_where_it_is(kink):
    """Its size times its move is the derivative; one is at a time of the samples, one close to the end."""

    def before(t):
        return np.sin(2 * t) ** 2

    def after(t):
        return 2 + np.cos(3 * t)

    @jax.jit
    @jax.value_and_grad
    def integral_and_slope(kink):
        times = jnp.linspace(0.0, 5.0, 161)
        values = jnp.where(times >= kink, 2 + jnp.cos(3 * times), jnp.sin(2 * times) ** 2)
        return integrate_samples(times, values[:, None], jnp.stack([jnp.inf, kink]))[0]

    exact = scipy.integrate.quad(before, 0, kink)[0] + scipy.integrate.quad(after, kink, 5)[0]
    value, slope = integral_and_slope(kink)
    # On each side of a jump the order is four, with steps of 1/32.
    np.testing.assert_allclose(value, exact, rtol=0, atol=1e-5)  # the trapezoidal rule: 2e-2
    np.testing.assert_allclose(slope, before(kink) - after(kink), rtol=0, atol=2e-3)
