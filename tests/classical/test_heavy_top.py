"""The heavy top: steady precession, the integrals of Lagrange and Kovalevskaya, and where they break.

Runs are at tolerance 1e-12, and drift by a few hundred times that.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics import classical
from tests.classical.mechanics import turn

TIMES = np.linspace(0.0, 10.0, 41)
SETTINGS = {"rtol": 1e-12, "atol": 1e-12, "dense": True}  # those of other tests, so that all share a program
START = classical.RigidBodyState([0.9, 0.3, -0.3, 0.1], [0.4, -0.3, 1.9])


def run(inertia, chi, start=START):
    top = classical.HeavyTop(mass=0.5, inertia=inertia, chi=chi, gravity=3.0)
    return jaxball.simulate(top, TIMES, start, **SETTINGS).raise_if_failed()


@pytest.fixture(scope="module")
def lagrange():
    return run((1.3, 1.3, 0.8), (0.0, 0.0, 0.7))


@pytest.fixture(scope="module")
def skew():
    return run((1.3, 1.1, 0.8), (0.0, 0.0, 0.7))


@pytest.mark.thorough
def test_steady_precession():
    """A P² cos θ − d3 Ω3 P + mgl = 0: the top precesses at the rate P about the vertical, at the angle θ from it."""
    A, C, l, P, theta = 1.3, 0.8, 0.7, 1.1, 0.6
    spin = (A * P**2 * np.cos(theta) + 0.5 * 3.0 * l) / (C * P) - P * np.cos(theta)
    Omega = P * np.array([0.0, np.sin(theta), np.cos(theta)]) + np.array([0.0, 0.0, spin])
    start = classical.RigidBodyState([np.cos(theta / 2), np.sin(theta / 2), 0.0, 0.0], Omega)
    trajectory = run((A, A, C), (0.0, 0.0, l), start)
    Lambda = jax.vmap(lambda s: s.Lambda)(trajectory.state)
    expected = jax.vmap(lambda t: turn(2, P * t) @ turn(0, theta) @ turn(2, spin * t))(jnp.asarray(TIMES))
    np.testing.assert_allclose(Lambda, expected, rtol=0, atol=4e-9)


@pytest.mark.thorough
def test_integrals_of_the_symmetric_top(lagrange):
    for name, value in lagrange.laws._asdict().items():
        np.testing.assert_allclose(value, value[0], rtol=0, atol=5e-9, err_msg=name)
    assert np.ptp(jax.vmap(lambda s: s.Gamma)(lagrange.state)[:, 2]) > 0.3


def test_lagranges_integral_is_that_of_symmetric_tops_alone(skew):
    """The negative control: d1 ≠ d2 leaves the energy and the vertical momentum, and nothing else."""
    laws = skew.laws
    assert np.ptp(laws.axial_momentum) > 0.05
    assert np.ptp(laws.energy) < 1e-8
    assert np.ptp(laws.vertical_momentum) < 1e-8


def test_the_energies_are_those_of_the_formula(skew):
    """mg times the height of the centre of mass, by the rotation matrix, and the kinetic energy."""
    Lambda = np.asarray(jax.vmap(lambda s: s.Lambda)(skew.state))
    height = (Lambda @ np.array([0.0, 0.0, 0.7]))[:, 2]
    Omega = np.asarray(skew.state.Omega)
    expected = 0.5 * np.sum(np.array([1.3, 1.1, 0.8]) * Omega**2, axis=1) + 0.5 * 3.0 * height
    np.testing.assert_allclose(skew.laws.energy, expected, rtol=0, atol=5e-15)
    assert np.ptp(height) > 0.2


def kovalevskaya(trajectory, c):
    """|(Ω1 + iΩ2)² − c (Γ1 + iΓ2)|² with c = mgl / d3."""
    w = np.asarray(trajectory.state.Omega) @ np.array([1, 1j, 0])
    gamma = np.asarray(jax.vmap(lambda s: s.Gamma)(trajectory.state)) @ np.array([1, 1j, 0])
    return np.abs(w**2 - c * gamma) ** 2


def test_kovalevskayas_integral():
    """d1 = d2 = 2 d3 and χ on E1; the control has its centre of mass on E1, and d1 = d2 = 1.8 d3."""
    assert np.ptp(kovalevskaya(run((2.0, 2.0, 1.0), (0.8, 0.0, 0.0)), 0.5 * 3.0 * 0.8)) < 1e-8
    assert np.ptp(kovalevskaya(run((1.8, 1.8, 1.0), (0.8, 0.0, 0.0)), 0.5 * 3.0 * 0.8)) > 1e-2
