"""The particle with ż = y ẋ: the closed form of its motion, and how the vakonomic particle differs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

import jaxball
from jaxball.physics import classical

TIMES = np.linspace(0.0, 5.0, 21)
TOLERANCES = {"rtol": 1e-12, "atol": 1e-12}
PARTICLE = classical.NonholonomicParticle()


@pytest.fixture(scope="module")
def mechanical():
    return jaxball.simulate(
        PARTICLE, TIMES, classical.ParticleState(1.0, 1.0, 0.0, 1.0, 1.0), **TOLERANCES
    ).raise_if_failed()


@pytest.fixture(scope="module")
def vakonomic():
    start = classical.VakonomicState(1.0, 1.0, 0.0, 1.0, 1.0)
    return jaxball.simulate(classical.VakonomicParticle(), TIMES, start, **TOLERANCES).raise_if_failed()


@jax.jit
@jax.vmap
def closed_form(t, start):
    """The state at t, and its rate by forward mode beside the field."""
    zero = jnp.zeros_like(t)
    state, rate = jax.jvp(lambda t: PARTICLE.solution(t, start, zero), (t,), (jnp.ones_like(t),))
    return state, rate, PARTICLE.field(t, state)


def test_the_closed_form_is_the_papers(mechanical):
    """x = B ln(ct + d + √(1 + (ct + d)²)) + E of ``eq_part_LdA_x``, with c = d = 1, B = √2."""
    B = np.sqrt(2.0)
    x = B * np.log(TIMES + 1 + np.sqrt(1 + (TIMES + 1) ** 2)) + 1 - B * np.log(1 + np.sqrt(2.0))
    np.testing.assert_allclose(mechanical.state.x, x, rtol=0, atol=1e-10)
    np.testing.assert_allclose(mechanical.state.y, 1 + TIMES, rtol=0, atol=5e-14)
    start = jax.tree.map(lambda leaf: leaf[:1].repeat(len(TIMES)), mechanical.state)
    state, _, _ = closed_form(jnp.asarray(TIMES), start)
    np.testing.assert_allclose(state.x, x, rtol=0, atol=3e-15)
    np.testing.assert_allclose(state.z, mechanical.state.z, rtol=0, atol=5e-10)
    np.testing.assert_allclose(state.xdot, mechanical.state.xdot, rtol=0, atol=5e-11)


def test_the_closed_form_solves_the_equations_for_any_start():
    """For y of both signs and through 0, and for ẏ from 0 to 1: to the rounding of derivatives of square roots."""
    rng = np.random.default_rng(6)
    ydot = np.concatenate([[0.0, 1e-300, 1e-12, -1e-12, 1e-5, -1e-4, 1e-3], rng.uniform(-1, 1, 20)])
    n = len(ydot)
    numbers = [*rng.normal(size=(4, n)), ydot]
    start = classical.ParticleState(*map(jnp.asarray, numbers))
    state, rate, field = closed_form(jnp.asarray(rng.uniform(-4, 4, n)), start)
    for found, expected in zip(jax.tree.leaves(rate), jax.tree.leaves(field), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-14)
    at_start, _, _ = closed_form(jnp.zeros(n), start)
    np.testing.assert_array_equal(at_start.x, start.x)
    assert np.all(np.isfinite(state.x))


def test_derivatives_of_the_closed_form_with_respect_to_ydot():
    """∂x/∂ẏ by quadrature of the derivative of ẋ, which is smooth through ẏ = 0."""
    t, y0, ydots = 1.5, -0.3, [0.0, 1e-7, 0.4]

    def speed_slope(tau, ydot):
        y = y0 + ydot * tau
        return -np.sqrt(1 + y0**2) * y * tau / (1 + y**2) ** 1.5

    def x(ydot):
        zero = jnp.zeros_like(ydot)
        start = classical.ParticleState(zero, zero + y0, zero, zero + 1.0, ydot)
        return PARTICLE.solution(zero + t, start, zero).x

    expected = [scipy.integrate.quad(speed_slope, 0.0, t, args=(ydot,), epsabs=1e-13)[0] for ydot in ydots]
    found = jax.jit(jax.vmap(jax.grad(x)))(jnp.asarray(ydots))
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-15)


def test_laws_of_both(mechanical, vakonomic):
    for trajectory in (mechanical, vakonomic):
        for name, value in trajectory.laws._asdict().items():
            np.testing.assert_allclose(value, value[0], rtol=0, atol=2e-10, err_msg=name)
    np.testing.assert_allclose(mechanical.laws.energy[0], 1.5)
    # Noether's momenta are not constant in mechanics, and p_y is not in the vakonomic motion.
    assert np.ptp(mechanical.state.xdot) > 0.3
    assert np.ptp(vakonomic.state.ydot) > 0.3


def test_the_vakonomic_motion_is_a_geodesic(vakonomic):
    """With λ = −ż the action is the length on the surface with the metric (1 + y²) dx² + dy².

    There (1 + y²) ẋ = k and ẏ² + k²/(1 + y²) = 2E are constants, so that t = ∫ dy / √(2E − k²/(1 + y²)).
    """
    k, E2 = 2.0, 3.0
    for j in (7, 20):
        t, _ = scipy.integrate.quad(
            lambda y: 1 / np.sqrt(E2 - k**2 / (1 + y**2)), 1.0, float(vakonomic.state.y[j]), epsabs=1e-12
        )
        np.testing.assert_allclose(t, TIMES[j], rtol=0, atol=1e-10)
        x, _ = scipy.integrate.quad(
            lambda y: k / (1 + y**2) / np.sqrt(E2 - k**2 / (1 + y**2)), 1.0, float(vakonomic.state.y[j]), epsabs=1e-12
        )
        np.testing.assert_allclose(1 + x, vakonomic.state.x[j], rtol=0, atol=1e-10)


def test_the_two_principles_disagree(mechanical, vakonomic):
    """``fig_LdA_vak``: they part at the second order in time, ÿ = 0 and ÿ = y ẋ² = 1."""
    difference = np.asarray(vakonomic.state.y - mechanical.state.y)
    assert np.all(difference[1:] > 0)
    t = TIMES[1]
    np.testing.assert_allclose(difference[1], t**2 / 2, rtol=0.2)
