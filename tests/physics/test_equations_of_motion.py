"""The moment form of the equations against the paper's sums, printed forms and special cases.

The two forms are the same sums in another order, so they differ by rounding alone: 1e-13 of the
largest component leaves room for some hundred roundings.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.physics.dynamics.equations import angles_in_state
from tests.support import direct_sum
from tests.support.precision import scaled
from tests.support.systems import (
    COUNT,
    KINDS,
    all_masses,
    every_motion,
    random_cases,
    random_disks,
    stacked,
    static_ball,
)

pytestmark = pytest.mark.any_precision

ROUNDING = scaled(1e-13)
rate_of = jax.jit(jaxball.physics.vector_field)
rates_of = jax.jit(jax.vmap(jaxball.physics.vector_field))


def in_float64(leaf):
    """The sums are added up in float64, whatever the type of the equations."""
    return np.asarray(leaf, dtype="float64")


def relative(found, expected):
    """The largest difference in each case, relative to the case's largest component (and to 1)."""
    found, expected = np.atleast_2d(found), np.atleast_2d(expected)
    return np.max(np.abs(found - expected), axis=-1) / np.maximum(1, np.max(np.abs(expected), axis=-1))


@jax.jit
@jax.vmap
def sums_and_rates(system, t, state):
    """What the direct sum needs, and the library's rates."""
    Fe = system.force(t)
    masses = all_masses(system, t, angles_in_state(system, t, state))
    return masses, Fe, jaxball.physics.vector_field(system, t, state)


@pytest.fixture(scope="module", params=KINDS)
def balls(request):
    system, t, state = random_cases(request.param)
    masses, Fe, rates = sums_and_rates(system, t, state)
    return jax.tree.map(in_float64, (system, state, masses, Fe, rates))


def direct_sums(system, state, masses, Fe):
    rotations = [direct_sum.rotation(q) for q in state.q]
    return np.array(
        [
            direct_sum.ball_angular_acceleration(
                *(part[k] for part in masses),
                system.inertia[k],
                system.radius[k],
                system.gravity[k],
                state.Omega[k],
                rotations[k][2],
                rotations[k].T @ Fe[k],
            )
            for k in range(COUNT)
        ]
    )


@pytest.mark.long
def test_the_direct_sum_over_masses_gives_the_same_angular_acceleration(balls):
    system, state, masses, Fe, rates = balls
    assert np.max(relative(rates.Omega, direct_sums(system, state, masses, Fe))) < ROUNDING


@pytest.mark.thorough
def test_rates_of_orientation_and_path_are_those_of_the_rolling_constraint(balls):
    system, state, _, _, rates = balls
    for k in range(COUNT):
        Lambda, step = direct_sum.rotation(state.q[k]), 1e-20
        turned = direct_sum.rotation(state.q[k] + 1j * step * rates.q[k]).imag / step
        np.testing.assert_allclose(turned, Lambda @ direct_sum.hat(state.Omega[k]), atol=scaled(1e-14))
        velocity = np.cross(Lambda @ state.Omega[k], [0, 0, system.radius[k]])
        np.testing.assert_allclose(rates.z[k], velocity[:2], atol=scaled(1e-14))


@pytest.mark.thorough
def test_a_fixed_mass_is_static_internal_structure():
    """``uncon_ball_eqns_static2``: the fixed mass moves the shell's centre of mass and its inertia."""
    system, t, state = random_cases("static")
    rates = rates_of(system, t, state)
    masses = masses_of(system, t)[:2]
    for k, (m, chi) in enumerate(zip(*map(np.asarray, masses), strict=True)):
        whole = m.sum()
        centre = m @ chi / whole
        spread = sum(
            m_i * direct_sum.hat(x - centre) @ direct_sum.hat(x - centre) for m_i, x in zip(m, chi, strict=True)
        )
        moments, axes = np.linalg.eigh(np.diag(system.inertia[k]) - spread)
        axes = axes * np.sign(np.linalg.det(axes))
        Lambda = direct_sum.rotation(np.asarray(state.q[k]))
        Fe = np.asarray(jax.tree.map(lambda leaf, k=k: leaf[k], system.force)(t[k]))
        expected = axes @ direct_sum.static_angular_acceleration(
            whole,
            axes.T @ centre,
            moments,
            system.radius[k],
            system.gravity[k],
            axes.T @ state.Omega[k],
            axes.T @ Lambda[2],
            axes.T @ Lambda.T @ Fe,
        )
        assert relative(rates.Omega[k], expected) < ROUNDING


@jax.jit
@jax.vmap
def masses_of(system, t):
    return all_masses(system, t, (jnp.zeros(0),) * 3)


def test_a_ball_without_masses_is_its_shell():
    shell = jaxball.Ball(mass=1.3, inertia=(0.5, 0.6, 0.7), radius=1.2, offset=(0.1, -0.2, 0.3), gravity=9.8)
    q, Omega = np.array([0.5, -0.5, 0.1, 0.7]), np.array([0.3, -1.1, 0.8])
    q /= np.linalg.norm(q)
    rates = rate_of(shell, jnp.asarray(0.0), jaxball.BallState(q, Omega))
    Gamma = direct_sum.rotation(q)[2]
    expected = direct_sum.static_angular_acceleration(
        1.3, np.array([0.1, -0.2, 0.3]), (0.5, 0.6, 0.7), 1.2, 9.8, Omega, Gamma, np.zeros(3)
    )
    assert relative(rates.Omega, expected) < ROUNDING


@pytest.mark.thorough
def test_versor_matrix_and_reduced_forms_agree():
    system, t, state = random_cases("driven")
    matrices = jax.vmap(jaxball.numerics.versor.rotation_matrix)(state.q)
    versor = rates_of(system, t, state)
    angles = (state.theta, state.thetadot)
    matrix = rates_of(system, t, jaxball.physics.RotationState(matrices, state.Omega, state.z, *angles))
    assert np.max(relative(matrix.Omega, versor.Omega)) < ROUNDING
    assert np.max(relative(matrix.z, versor.z)) < ROUNDING
    for Lambda, Omega, rate in zip(*map(np.asarray, (matrices, state.Omega, matrix.Lambda)), strict=True):
        np.testing.assert_allclose(rate, Lambda @ direct_sum.hat(Omega), atol=scaled(1e-14))

    free = without_force(system)
    Gamma = matrices[:, 2]
    unforced = rates_of(free, t, state)
    reduced = rates_of(free, t, jaxball.physics.ReducedState(state.Omega, Gamma, *angles))
    assert np.max(relative(reduced.Omega, unforced.Omega)) < ROUNDING
    np.testing.assert_allclose(reduced.Gamma, np.cross(Gamma, state.Omega), atol=scaled(1e-14))


def without_force(system):
    """The same stacked balls with no external force."""
    return eqx.tree_at(lambda ball: ball.force, system, None, is_leaf=lambda x: x is system.force)


@pytest.mark.thorough
def test_the_disk_is_the_scalar_equation_of_the_paper():
    system, t, state = random_disks()
    masses, Fe, rates = jax.tree.map(in_float64, sums_and_rates(system, t, state))
    expected = [
        direct_sum.disk_angular_acceleration(
            *(part[k] for part in masses),
            system.inertia[k],
            system.radius[k],
            system.gravity[k],
            state.phi[k],
            state.phidot[k],
            Fe[k, 0],
        )
        for k in range(COUNT)
    ]
    np.testing.assert_allclose(rates.phidot, expected, rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_array_equal(rates.phi, state.phidot)
    np.testing.assert_allclose(rates.z, -system.radius * state.phidot, rtol=scaled(1e-15))


@pytest.mark.thorough
def test_the_disk_embedded_in_a_ball_rolls_alike():
    system, t, state = random_disks()
    flat = rates_of(system, t, state)
    rates = embedded_rates(system, t, state)
    spatial = np.stack([0 * flat.phidot, -flat.phidot, 0 * flat.phidot], axis=-1)
    assert np.max(relative(rates.Omega, spatial)) < ROUNDING
    np.testing.assert_allclose(rates.z[:, 0], flat.z, atol=scaled(1e-14))
    np.testing.assert_allclose(rates.z[:, 1], 0, atol=scaled(1e-14))


@jax.jit
@jax.vmap
def embedded_rates(disk, t, state):
    return jaxball.physics.vector_field(disk.embed(), t, state.in_space())


def test_newtons_laws_give_the_disk_with_one_mass():
    """``eq:srd_newton2``, the paper's own check by forces and torques."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        m0, m1, d2, r, g, phi, phidot, theta, rate = rng.uniform(0.3, 2, 9)
        r1, u, push = 0.7 * r, *rng.normal(size=2)
        schedule = jaxball.PiecewiseAcceleration(theta, [0.0, 1.0], [[u]], rate)
        disk = jaxball.Disk(
            mass=m0,
            inertia=d2,
            radius=r,
            gravity=g,
            force=jaxball.physics.HarmonicForce([push, 0.0, 0.0]),
            masses=[jaxball.PointMass(m1, jaxball.OnRail(jaxball.Circle(r1), schedule))],
        )
        found = rate_of(disk, jnp.asarray(0.0), jaxball.DiskState(phi, phidot)).phidot
        expected = direct_sum.newton_disk_acceleration(m0, m1, d2, r, r1, g, phi, phidot, theta, rate, u, push)
        np.testing.assert_allclose(found, expected, rtol=scaled(1e-13))


@pytest.mark.thorough
def test_masses_of_every_kind_keep_their_order():
    """Grouping by structure must not shuffle what is asked for mass by mass."""
    rng = np.random.default_rng(5)
    ball = every_motion(rng)
    mixed = jaxball.Ball(
        mass=ball.mass,
        inertia=ball.inertia,
        masses=[item for pair in zip(ball.point_masses[:5], ball.point_masses[5:10], strict=True) for item in pair],
    )
    t = jnp.asarray(0.3)
    alone = jax.jit(lambda items: [item.motion.prepare().kinematics(t).chi for item in items])
    _, chi, _, _ = jax.jit(all_masses)(mixed, t, (jnp.zeros(0),) * 3)
    np.testing.assert_allclose(chi[1:], alone(mixed.point_masses), rtol=scaled(1e-14), atol=scaled(1e-15))


def test_equal_cases_of_the_two_seeds_differ():
    """The random cases are not one case many times."""
    system = stacked(static_ball, 3, seed=0)
    assert np.unique(system.radius).size == 3
