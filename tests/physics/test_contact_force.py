"""The reaction of the plane against Newton's law with accelerations differentiated twice in space."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.dynamics.equations import angles_in_state
from tests.support.direct_sum import newton_disk_acceleration
from tests.support.flow import along_flow
from tests.support.systems import all_masses, random_cases, random_disks


def places_in_space(system, t, state):
    """Where every mass and the shell's centre of mass are in space, from the origin."""
    _, chi, _, _ = all_masses(system, t, angles_in_state(system, t, state))
    state = state.in_space() if isinstance(state, jaxball.DiskState) else state
    centre = jnp.concatenate([state.z, jnp.zeros(1)])
    return centre[None] + chi @ state.Lambda.T


@jax.jit
@jax.vmap
def reaction(system, t, state):
    """R from Newton's second law for the whole, and the library's."""

    def velocities(t, x):
        return along_flow(lambda t, x: places_in_space(system, t, x), system, t, x)[1]

    accelerations = along_flow(velocities, system, t, state)[1]
    m = all_masses(system, t, angles_in_state(system, t, state))[0]
    R = jnp.sum(m[:, None] * accelerations, axis=0) - system.force(t)
    R = R.at[2].add(jnp.sum(m) * system.gravity)
    seen = jaxball.observe(system, t, state)
    return R, jnp.concatenate([seen.friction, seen.normal_force[None]]), seen.friction_ratio


def check(R, found, ratio):
    np.testing.assert_allclose(found, R, rtol=1e-11, atol=1e-11 * np.max(np.abs(R)))
    held = R[:, 2] > 0
    np.testing.assert_allclose(ratio[held], np.hypot(R[held, 0], R[held, 1]) / R[held, 2], rtol=1e-9)
    assert np.all(np.isinf(ratio[~held]))


@pytest.mark.long
def test_the_reaction_is_what_newtons_law_asks_of_the_plane():
    """Two derivatives in space lose some digits to cancellation: 1e-11 of the largest force."""
    check(*map(np.asarray, reaction(*random_cases("driven", seed=31))))


@pytest.mark.thorough
def test_the_reaction_on_a_disk():
    check(*map(np.asarray, reaction(*random_disks(seed=32))))


def test_a_ball_at_rest_presses_with_its_weight():
    ball = jaxball.Ball(
        mass=1.5,
        inertia=(0.5, 0.6, 0.7),
        offset=(0.0, 0.0, -0.2),
        gravity=9.81,
        masses=[jaxball.PointMass(0.5, jaxball.Fixed([0.0, 0.0, -0.4]))],
    )
    seen = jax.jit(jaxball.observe)(ball, jnp.asarray(0.0), jaxball.BallState())
    np.testing.assert_allclose(seen.normal_force, 2.0 * 9.81, rtol=1e-15)
    np.testing.assert_allclose(seen.friction, 0.0, atol=1e-15)


def test_friction_of_the_disk_is_minus_the_papers():
    """Section 3.3: f_s = m0 r φ̈ + Fe − m1 z̈_1, along −e1, and N = −Fe3 + (m0 + m1) g + m1 z̈_3."""
    m0, m1, d2, r, r1, g, phi, phidot, theta, rate = 1.3, 0.7, 0.5, 1.2, 0.8, 9.8, 0.4, -0.9, 0.3, 1.7
    push, lift = 0.35, 0.2
    disk = jaxball.Disk(
        mass=m0,
        inertia=d2,
        radius=r,
        gravity=g,
        force=jaxball.physics.HarmonicForce([push, 0.0, lift]),
        masses=[jaxball.PointMass(m1, jaxball.OnRail(jaxball.Circle(r1), jaxball.ConstantRate(theta, rate)))],
    )
    seen = jax.jit(jaxball.observe)(disk, jnp.asarray(0.0), jaxball.DiskState(phi, phidot))
    phiddot = newton_disk_acceleration(m0, m1, d2, r, r1, g, phi, phidot, theta, rate, 0.0, push)
    angle, spin = phi + theta, phidot + rate
    z1 = -r * phiddot - r1 * (np.cos(angle) * spin**2 + np.sin(angle) * phiddot)
    z3 = r1 * (-np.sin(angle) * spin**2 + np.cos(angle) * phiddot)
    np.testing.assert_allclose(seen.friction[0], -(m0 * r * phiddot + push - m1 * z1), rtol=1e-13)
    np.testing.assert_allclose(seen.normal_force, -lift + (m0 + m1) * g + m1 * z3, rtol=1e-13)
