"""Lyapunov exponents of rolling bodies: hyperbolic equilibria, integrable spheres, reversible and driven motion."""

import jax
import numpy as np
import pytest

import jaxball
from jaxball.chaos import lyapunov_spectrum
from jaxball.paper import ball as paper_ball

D, M, R, G, HIGH = np.array([0.5, 0.65, 0.7]), 1.3, 1.2, 9.8, 0.3


def top_heavy(force=None):
    return jaxball.Ball(mass=M, inertia=D, radius=R, gravity=G, offset=(0.0, 0.0, HIGH), force=force)


def growth_rates():
    """±√( M g ℓ / (d_j + M (r + ℓ)²) ): the rocking frequency with −ℓ for a, imaginary."""
    rates = np.sqrt(M * G * HIGH / (D[:2] + M * (R + HIGH) ** 2))
    return np.sort(np.concatenate([rates, -rates]))[::-1]


def test_a_top_heavy_ball_at_rest_has_the_real_parts_of_its_eigenvalues():
    found = lyapunov_spectrum(top_heavy(), (0.0, 30.0), transient=20.0)
    fast, slow = growth_rates()[:2]
    np.testing.assert_allclose(found.exponents, [fast, slow, 0.0, -slow, -fast], atol=1e-8)
    assert found.dimension == pytest.approx(5.0, abs=1e-7)


def test_the_full_state_adds_zeros_for_place_and_heading():
    """A force of no size keeps the state from being reduced."""
    nothing = jaxball.HarmonicForce(np.zeros(3), np.zeros((1, 3)), [1.0], [0.0])
    found = lyapunov_spectrum(top_heavy(nothing), (0.0, 40.0), transient=30.0)
    fast, slow = growth_rates()[:2]
    np.testing.assert_allclose(found.exponents, [fast, slow, 0.0, 0.0, 0.0, 0.0, -slow, -fast], atol=1e-7)


def test_a_disk_with_its_centre_of_mass_above():
    """The same rate about E2; the third exponent is that of z."""
    disk = jaxball.Disk(mass=M, inertia=D[1], radius=R, gravity=G, offset=(0.0, 0.0, HIGH))
    found = lyapunov_spectrum(disk, (0.0, 30.0), transient=20.0)
    rate = np.sqrt(M * G * HIGH / (D[1] + M * (R + HIGH) ** 2))
    np.testing.assert_allclose(found.exponents, [rate, 0.0, -rate], atol=1e-8)


def test_a_mass_that_a_spring_drives_adds_its_own_exponents():
    """θ̈ = −k θ − c θ̇, whatever the ball does: the roots of λ² + c λ + k = 0."""
    law = jaxball.FunctionLaw(lambda t, state, parameters: -2.0 * state.theta - 3.0 * state.thetadot)
    mass = jaxball.PointMass(0.2, jaxball.Driven(jaxball.Circle(0.5)))
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.5, 0.6), offset=(0.0, 0.0, -0.1), masses=[mass], law=law)
    rest = jaxball.BallState(theta=[0.0], thetadot=[0.0])
    found = lyapunov_spectrum(ball, (0.0, 60.0), rest, transient=20.0)
    assert found.exponents.shape == (7,)
    np.testing.assert_allclose(np.sort(found.exponents)[:2], [-2.0, -1.0], atol=2e-3)


CHAPLYGIN = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.8), radius=1.0)
LEANING = jaxball.BallState(q=[0.9, 0.3, -0.3, 0.1], Omega=[0.7, -0.5, 1.1])


def test_a_chaplygin_sphere_has_no_exponent_but_zero():
    """Its motion is integrable (Chaplygin 1903): deviations grow linearly, means tend to zero as log(t) / t."""
    found = lyapunov_spectrum(CHAPLYGIN, (0.0, 400.0), LEANING, interval=4.0, rtol=1e-8, atol=1e-8)
    assert found.ok
    assert float(np.max(np.abs(found.exponents))) < 4 * np.log(400.0) / 400.0


def test_exponents_do_not_depend_on_the_kind_of_state():
    """A versor, a matrix and (Ω, Γ) are one phase point."""
    reduced = jaxball.ReducedState(LEANING.Omega, LEANING.Gamma)
    matrix = jaxball.RotationState(LEANING.Lambda, LEANING.Omega)
    runs = [lyapunov_spectrum(CHAPLYGIN, (0.0, 5.0), state).exponents for state in (LEANING, reduced, matrix)]
    np.testing.assert_allclose(runs[1], runs[0], atol=1e-12)
    np.testing.assert_allclose(runs[2], runs[0], atol=1e-12)


@pytest.fixture(scope="module")
def chaotic():
    """A ball whose moments differ and whose centre of mass is off the centre, spinning."""
    ball = jaxball.Ball(mass=1.0, inertia=(0.3, 0.45, 0.6), offset=(0.12, 0.2, 0.1))
    return lyapunov_spectrum(ball, (0.0, 1000.0), LEANING, interval=2.0, rtol=1e-9, atol=1e-9).raise_if_failed()


