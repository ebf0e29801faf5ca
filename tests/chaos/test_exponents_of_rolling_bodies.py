"""Lyapunov exponents of rolling bodies: hyperbolic equilibria, integrable spheres, chaotic tops.

Balls without masses share one program, because every run has eighty intervals, of which forty are transient.
"""

import re

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.analysis.chaos import lyapunov_spectrum
from tests.support.sentences import refuses, said

D, M, R, G, HIGH = np.array([0.5, 3.0, 3.1]), 1.0, 1.0, 9.8, 0.1
LEANING = jaxball.BallState(q=[0.9, 0.3, -0.3, 0.1], Omega=[0.7, -0.5, 1.1])
CHAPLYGIN = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.8))


def shell(**changes):
    return jaxball.Ball(mass=M, inertia=D, radius=R, gravity=G, offset=(0.0, 0.0, HIGH), **changes)


def spectrum(system, length, state=None):
    return lyapunov_spectrum(system, (0.0, length), state, transient=length / 2, interval=length / 80).raise_if_failed()


@pytest.mark.long
def test_a_top_heavy_ball_at_rest_has_the_real_parts_of_its_eigenvalues():
    """±√( M g ℓ / (d_j + M (r + ℓ)²) ): the rocking frequency with −ℓ for a, imaginary."""
    found = spectrum(shell(), 120.0)
    fast, slow = np.sqrt(M * G * HIGH / (D[:2] + M * (R + HIGH) ** 2))
    np.testing.assert_allclose(found.exponents, [fast, slow, 0.0, -slow, -fast], atol=1e-8)
    assert found.dimension == pytest.approx(5.0, abs=1e-6)


@pytest.mark.slow
def test_forces_and_driven_masses_enlarge_the_phase_space():
    """A force, though of no size, keeps place and heading: three zeros. A mass at the centre, on a spring that
    takes no notice of the ball, adds the roots of λ² + 3λ + 2 = 0, and its inertia m r². Where the ball spins a
    little, its heading grows as t, which is log(t₁/t₀) / (t₁ − t₀) in a mean.
    """
    nothing = jaxball.physics.HarmonicForce(np.zeros(3), np.zeros((1, 3)), [1.0], [0.0])
    law = jaxball.FunctionLaw(lambda t, state, parameters: -2.0 * state.theta - 3.0 * state.thetadot)
    mass = jaxball.PointMass(0.4, jaxball.Driven(jaxball.Tube([1.0, 0.0, 0.0])))
    rest = jaxball.BallState(theta=[0.0], thetadot=[0.0])
    found = lyapunov_spectrum(shell(force=nothing, masses=[mass], law=law), (0.0, 120.0), rest, transient=90.0)
    fast, slow = np.sqrt(M * G * HIGH / (D[:2] + M * (R + HIGH) ** 2 + 0.4 * R**2))
    turning = np.log(120 / 90) / 30
    wanted = [fast, slow, turning, 0.0, 0.0, -turning, -slow, -fast, -1.0, -2.0]
    np.testing.assert_allclose(found.exponents, wanted, atol=1e-4)


@pytest.mark.slow
def test_a_disk_with_its_centre_of_mass_above():
    """The same rate about E2; the third exponent is that of z."""
    disk = jaxball.Disk(mass=M, inertia=D[1], radius=R, gravity=G, offset=(0.0, 0.0, HIGH))
    rate = np.sqrt(M * G * HIGH / (D[1] + M * (R + HIGH) ** 2))
    np.testing.assert_allclose(spectrum(disk, 120.0).exponents, [rate, 0.0, -rate], atol=1e-7)


@pytest.mark.thorough
@pytest.mark.parametrize(("end", "tolerance"), [(400.0, 1e-8), (415.0, 1e-4)])
def test_what_is_printed_of_a_disk_on_its_head_holds(end, tolerance):
    """The deviations turn to their directions at first, which the means remember as 1/t, however exact the later rates
    are. 415 intervals are no multiple of the parts from which errors are estimated, whose first has them too.
    """
    height = 0.8
    disk = jaxball.Disk(mass=1.0, inertia=0.36, offset=(0.0, 0.0, height))
    rate = np.sqrt(height / (0.36 + (1.0 + height) ** 2))
    found = lyapunov_spectrum(disk, (0.0, end), solver=diffrax.Dopri5(), rtol=tolerance, atol=tolerance)
    numbers = [re.findall(r"-?\d+\.\d+", line) for line in str(found).splitlines() if "±" in line]
    values, errors = np.array(numbers, float).T
    exact = np.array([rate, 0.0, -rate])
    assert np.all(np.abs(values - exact) <= errors)
    assert np.all((errors > 0) & (errors < 100 * tolerance))
    # Two and a half standard errors, as everywhere.
    assert np.all(np.abs(found.exponents - exact) < 2.5 * found.standard_error)


@pytest.mark.thorough
def test_a_chaplygin_sphere_has_no_exponent_but_zero():
    """Its motion is integrable (Chaplygin 1903): deviations grow linearly, means tend to zero as log(t) / t."""
    found = spectrum(CHAPLYGIN, 400.0, LEANING)
    assert float(jnp.max(jnp.abs(found.exponents))) < 2 * np.log(400.0) / 400.0
    assert float(jnp.max(jnp.abs(jnp.sum(found.vectors[:, 3:] * found.x[None, 3:], axis=1)))) < 1e-10
    assert not np.any(found.told_from_zero)
    said(found.message)
    assert np.all(np.diff(found.exponents) <= 0)


@pytest.mark.slow
def test_exponents_do_not_depend_on_the_kind_of_state():
    """A versor, a matrix and (Ω, Γ) are one phase point."""
    reduced = jaxball.physics.ReducedState(LEANING.Omega, LEANING.Gamma)
    matrix = jaxball.physics.RotationState(LEANING.Lambda, LEANING.Omega)
    runs = [spectrum(CHAPLYGIN, 20.0, state).exponents for state in (LEANING, reduced, matrix)]
    np.testing.assert_allclose(runs[1], runs[0], atol=1e-12)
    np.testing.assert_allclose(runs[2], runs[0], atol=1e-12)


@pytest.mark.slow
def test_a_chaplygin_top_is_chaotic_and_keeps_two_zeros():
    """The flow and the energy give a zero each. The motion is reversible, and as chaotic back in time."""
    top = jaxball.Ball(mass=1.0, inertia=(2.0, 6.0, 7.0), offset=(1.0, 1.5, 1.9), radius=3.0, gravity=100.0)
    found = spectrum(top, 80.0, jaxball.BallState(Omega=[3.0, -2.0, 4.0]))
    exponents, error = np.asarray(found.exponents), np.asarray(found.standard_error)
    assert exponents[0] > 0.2
    assert np.all(np.abs(exponents[1:4]) < 4 * error[1:4] + 0.05)
    assert abs(exponents[0] + exponents[4]) < 4 * (error[0] + error[4])


@pytest.mark.thorough
def test_parameters_that_cannot_be_are_a_status():
    found = lyapunov_spectrum(jaxball.Ball(mass=-1.0, inertia=(0.5, 0.6, 0.8)), (0.0, 80.0), transient=40.0)
    assert not found.ok
    said(found.message)
    assert np.all(np.isnan(found.exponents))


def test_wrong_arguments():
    with refuses(ValueError, "exponents"):
        lyapunov_spectrum(CHAPLYGIN, (0.0, 1.0), exponents=6)
    with refuses(jaxball.simulation.PrecisionError, "rtol"):
        lyapunov_spectrum(CHAPLYGIN, (0.0, 1.0), rtol=1e-17, atol=1e-17)
    with refuses(TypeError, "state"):
        lyapunov_spectrum(CHAPLYGIN, (0.0, 1.0), jaxball.DiskState())


@pytest.mark.thorough
def test_a_classical_system_has_its_own_phase_space():
    """A free rigid body that spins about its middle axis: ±Ω √( (d2 − d1)(d3 − d2) / (d1 d3) ), and zeros."""
    body = jaxball.physics.classical.FreeRigidBody(inertia=(1.0, 2.0, 2.5))
    start = jaxball.physics.classical.RigidBodyState(Omega=[0.0, 1.5, 0.0])
    found = lyapunov_spectrum(body, (0.0, 120.0), start, transient=80.0)
    rate = 1.5 * np.sqrt((2.0 - 1.0) * (2.5 - 2.0) / (1.0 * 2.5))
    assert found.least_normal_force is None
    np.testing.assert_allclose(found.exponents[jnp.array([0, 5])], [rate, -rate], atol=1e-6)
    np.testing.assert_allclose(found.exponents[1:5], 0, atol=0.02)
