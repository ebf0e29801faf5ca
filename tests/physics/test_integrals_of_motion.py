"""Quantities that are constant over a run: Chaplygin's, Jellett's, Routh's and the energy.

Runs are at tolerance 1e-12; over ten units of time the integrals drift by less than 1e-9.
"""

import jax
import numpy as np
import pytest

import jaxball
from jaxball.physics.dynamics import momentum
from jaxball.physics.dynamics.equations import angles_in_state
from jaxball.physics.dynamics.moments import moments

TIMES = np.linspace(0.0, 10.0, 41)
TOLERANCES = {"rtol": 1e-12, "atol": 1e-12}


@jax.jit
def momenta(trajectory):
    """Π in body axes, ΛΠ, Γ and the integrals of the Routh sphere along a trajectory."""

    def at_time(t, state):
        ball = trajectory.system.prepare()
        place = moments(ball, t, angles_in_state(ball, t, state)), ball.radius, state.Omega, state.Gamma
        Pi = momentum.contact_momentum(*place)
        return Pi, state.Lambda @ Pi, state.Gamma, momentum.routh_integrals(*place)

    return jax.vmap(at_time)(trajectory.times, trajectory.state)


@pytest.fixture(scope="module")
def chaplygin():
    """Two equal masses opposed on one circle, swinging hard: p(t) = 0, and Coriolis terms do not cancel."""
    rail = jaxball.Circle(0.8, frame=jaxball.SphericalFrame(0.4, 0.7))
    masses = [
        jaxball.PointMass(0.7, jaxball.OnRail(rail, jaxball.Sinusoids(theta, [1.5], [2.3], [0.1], 0.9)))
        for theta in (0.3, 0.3 + np.pi)
    ]
    ball = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.8), gravity=9.8, masses=masses)
    start = jaxball.BallState(Omega=[0.7, -0.5, 1.1])
    return jaxball.simulate(ball, TIMES, start, **TOLERANCES).raise_if_failed()


@pytest.mark.long
def test_the_momentum_of_a_chaplygin_sphere_is_constant_while_masses_move(chaplygin):
    Pi, in_space, Gamma, _ = jax.tree.map(np.asarray, momenta(chaplygin))
    np.testing.assert_allclose(in_space, in_space[[0]].repeat(len(TIMES), axis=0), atol=1e-9)
    np.testing.assert_allclose(np.sum(Pi**2, axis=1), np.sum(Pi[0] ** 2), atol=1e-9)
    np.testing.assert_allclose(np.sum(Pi * Gamma, axis=1), Pi[0] @ Gamma[0], atol=1e-9)
    assert np.ptp(Pi, axis=0).min() > 0.1
    assert np.ptp(chaplygin.observables.energy) > 0.1


def routh_sphere(d1, d2):
    masses = [jaxball.PointMass(m, jaxball.Fixed([0.0, 0.0, height])) for m, height in ((0.5, 0.6), (0.3, -0.2))]
    ball = jaxball.Ball(mass=1.0, inertia=(d1, d2, 0.7), offset=(0.0, 0.0, -0.15), masses=masses)
    start = jaxball.BallState(q=[0.9, 0.3, -0.3, 0.1], Omega=[0.4, -0.3, 0.9])
    return jaxball.simulate(ball, TIMES, start, **TOLERANCES).raise_if_failed()


@pytest.mark.thorough
def test_jellett_and_routh_are_constant_for_an_axisymmetric_sphere():
    trajectory = routh_sphere(0.5, 0.5)
    integrals = momenta(trajectory)[3]
    assert np.ptp(integrals.jellett) < 1e-9
    assert np.ptp(integrals.routh) < 1e-9
    assert np.ptp(trajectory.observables.energy) < 1e-9
    assert np.ptp(trajectory.state.Omega[:, 2]) > 0.01


@pytest.mark.thorough
def test_only_the_energy_is_constant_where_the_moments_differ():
    trajectory = routh_sphere(0.5, 0.6)
    integrals = momenta(trajectory)[3]
    assert np.ptp(integrals.jellett) > 1e-3
    assert np.ptp(integrals.routh) > 1e-3
    assert np.ptp(trajectory.observables.energy) < 1e-9
