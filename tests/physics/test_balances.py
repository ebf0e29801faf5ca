"""Energy, momentum about the contact point and Jellett's quantity change as the laws of mechanics say.

Each quantity is differentiated along the motion by forward mode, at random states of random systems
with moving masses and forces. The two sides round differently: 1e-12 of their scale.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.dynamics import locked
from jaxball.physics.dynamics.equations import angles_in_state
from jaxball.physics.dynamics.load import load
from jaxball.physics.dynamics.moments import moments
from tests.support.flow import along_flow
from tests.support.systems import all_masses, random_cases, random_disks

ROUNDING = 1e-12


def energies(system, t, state):
    """The energy and the power put in."""
    seen = jaxball.observe(system, t, state)
    return seen.energy, seen.power


@jax.jit
@jax.vmap
def energy_balance(system, t, state):
    """The energy, its rate along the motion, and the power put in."""
    (energy, power), (rate, _) = along_flow(lambda t, x: energies(system, t, x), system, t, state)
    return energy, rate, power


def momentum_quantities(ball, t, state):
    """Π, L·s and their rates by the laws."""
    at = moments(ball, t, angles_in_state(ball, t, state))
    place = at, ball.radius, state.Omega, state.Gamma
    Ftilde = state.Lambda.T @ ball.force(t)
    Pi = locked.contact_momentum(*place)
    Pi_rate = locked.contact_momentum_rate(at, ball.radius, load(ball, t, state), Pi, state.Omega)
    return (Pi, locked.jellett(*place)), (Pi_rate, locked.jellett_rate(*place, Ftilde))


@jax.jit
@jax.vmap
def balances_of_balls(ball, t, state):
    """The energy balance; the rates of momenta along the motion and by the laws; momenta and masses."""

    def seen(t, x):
        return energies(ball, t, x), momentum_quantities(ball, t, x)

    ((energy, power), ((Pi, _), predicted)), ((rate, _), (changed, _)) = along_flow(seen, ball, t, state)
    angles = angles_in_state(ball, t, state)
    P = locked.linear_momentum(moments(ball, t, angles), ball.radius, state.Omega, state.Gamma)
    return (energy, rate, power), (changed, predicted), (Pi, P, state.Gamma, all_masses(ball, t, angles))


@functools.cache
def balances(kind):
    """All three of random balls, from one program."""
    return balances_of_balls(*random_cases(kind, seed=21))


# Masses that do not move are those of schedules that do not.
MOVING = "driven", "scheduled"


@pytest.mark.long
@pytest.mark.parametrize("kind", MOVING)
def test_the_energy_of_a_ball_changes_by_the_power_put_in(kind):
    (energy, rate, power), *_ = balances(kind)
    np.testing.assert_allclose(rate, power, rtol=ROUNDING, atol=ROUNDING * np.max(np.abs(energy)))


@pytest.mark.thorough
def test_the_energy_of_a_disk_changes_by_the_power_put_in():
    energy, rate, power = energy_balance(*random_disks(seed=22))
    np.testing.assert_allclose(rate, power, rtol=ROUNDING, atol=ROUNDING * np.max(np.abs(energy)))


@pytest.mark.long
@pytest.mark.parametrize("kind", MOVING)
def test_momentum_about_the_contact_point_and_jellett(kind):
    _, ((Pi, jellett), (Pi_rate, jellett_rate)), _ = balances(kind)
    np.testing.assert_allclose(Pi, Pi_rate, rtol=ROUNDING, atol=ROUNDING * np.max(np.abs(Pi_rate)))
    np.testing.assert_allclose(jellett, jellett_rate, rtol=ROUNDING, atol=ROUNDING * np.max(np.abs(jellett_rate)))


@pytest.mark.thorough
def test_momenta_are_the_sums_over_masses_that_they_stand_for():
    """Π = 𝕀Ω + Σ m s × (Ω × s + χ̇) and P = Σ m (Ω × s + χ̇), mass by mass in NumPy."""
    *_, found = balances("scheduled")
    Pi, P, Gamma, (m, chi, chidot, _) = jax.tree.map(np.asarray, found)
    system, _, state = random_cases("scheduled", seed=21)
    system, state = jax.tree.map(np.asarray, (system, state))
    for k in range(len(m)):
        Omega = state.Omega[k]
        s = system.radius[k] * Gamma[k] + chi[k]
        velocity = np.cross(Omega, s) + chidot[k]
        np.testing.assert_allclose(P[k], m[k] @ velocity, rtol=1e-12, atol=1e-12)
        expected = system.inertia[k] * Omega + m[k] @ np.cross(s, velocity)
        np.testing.assert_allclose(Pi[k], expected, rtol=1e-12, atol=1e-12)


def test_jellett_is_the_angular_momentum_about_the_centre_of_mass_along_s():
    """For axial masses and d1 = d2 it is the integral of the Routh sphere."""
    ball = jaxball.Ball(
        mass=1.2,
        inertia=(0.6, 0.6, 0.7),
        radius=1.1,
        offset=(0.0, 0.0, 0.2),
        masses=[jaxball.PointMass(0.4, jaxball.Fixed([0.0, 0.0, -0.5]))],
    )
    at = jax.jit(moments)(ball, jnp.asarray(0.0), (jnp.zeros(0),) * 3)
    Omega, Gamma = jnp.asarray([0.3, -0.7, 1.1]), jnp.asarray([0.6, 0.0, 0.8])
    general = locked.jellett(at, ball.radius, Omega, Gamma)
    special = locked.routh_integrals(at, ball.radius, Omega, Gamma).jellett
    np.testing.assert_allclose(general, special, rtol=1e-14)
