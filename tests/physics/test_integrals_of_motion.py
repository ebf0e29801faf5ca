"""The momentum of a Chaplygin sphere, whose masses move. verify/test_laws_of_balls has Jellett's and Routh's integrals.

The run is at tolerance 1e-12; over ten units of time the integrals drift by less than 1e-9.
"""

import jax
import numpy as np
import pytest

import jaxball
from jaxball.physics.dynamics import locked
from jaxball.physics.dynamics.equations import angles_in_state
from jaxball.physics.dynamics.moments import moments

TIMES = np.linspace(0.0, 10.0, 41)
TOLERANCES = {"rtol": 1e-12, "atol": 1e-12}


@jax.jit
def momenta(trajectory):
    """Π in body axes, ΛΠ and Γ along a trajectory."""

    def at_time(t, state):
        ball = trajectory.system.prepare()
        place = moments(ball, t, angles_in_state(ball, t, state)), ball.radius, state.Omega, state.Gamma
        Pi = locked.contact_momentum(*place)
        return Pi, state.Lambda @ Pi, state.Gamma

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
    Pi, in_space, Gamma = jax.tree.map(np.asarray, momenta(chaplygin))
    np.testing.assert_allclose(in_space, in_space[[0]].repeat(len(TIMES), axis=0), atol=1e-9)
    np.testing.assert_allclose(np.sum(Pi**2, axis=1), np.sum(Pi[0] ** 2), atol=1e-9)
    np.testing.assert_allclose(np.sum(Pi * Gamma, axis=1), Pi[0] @ Gamma[0], atol=1e-9)
    assert np.ptp(Pi, axis=0).min() > 0.1
    assert np.ptp(chaplygin.observables.energy) > 0.1
