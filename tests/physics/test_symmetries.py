"""What must not matter: the versor's sign, the choice of axes and origin, the masses' order, the units."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.numerics import versor
from tests.support.systems import ball_state, random_cases, scheduled_ball, shell

rate_of = jax.jit(jaxball.physics.vector_field)
rates_of = jax.jit(jax.vmap(jaxball.physics.vector_field))


@pytest.fixture(scope="module")
def case():
    system, t, state = random_cases("scheduled", seed=41)
    return system, t, state, rates_of(system, t, state)


@pytest.mark.thorough
def test_the_versor_and_its_negative_are_one_orientation(case):
    system, t, state, rates = case
    turned = rates_of(system, t, eqx.tree_at(lambda x: x.q, state, -state.q))
    np.testing.assert_array_equal(turned.Omega, rates.Omega)
    np.testing.assert_array_equal(turned.z, rates.z)
    np.testing.assert_array_equal(turned.q, -rates.q)


@pytest.mark.thorough
def test_a_turn_about_the_vertical_turns_the_motion(case):
    system, t, state, rates = case
    turn = versor.exponential(jnp.asarray([0.0, 0.0, 1.1]))
    R = versor.rotation_matrix(turn)
    q = jax.vmap(lambda q: versor.product(turn, q))(state.q)
    series = system.force.series
    force = [series.constant @ R.T, series.amplitude @ R.T]
    turned_system = eqx.tree_at(lambda b: (b.force.series.constant, b.force.series.amplitude), system, force)
    turned_state = eqx.tree_at(lambda x: (x.q, x.z), state, (q, state.z @ R[:2, :2].T))
    turned = rates_of(turned_system, t, turned_state)
    np.testing.assert_allclose(turned.Omega, rates.Omega, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(turned.z, rates.z @ R[:2, :2].T, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(turned.q, jax.vmap(lambda q: versor.product(turn, q))(rates.q), atol=1e-13)


@pytest.mark.thorough
def test_the_plane_is_the_same_everywhere(case):
    system, t, state, rates = case
    moved = rates_of(system, t, eqx.tree_at(lambda x: x.z, state, state.z + 100.0))
    for found, expected in zip(jax.tree.leaves(moved), jax.tree.leaves(rates), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.thorough
def test_the_order_of_the_masses_does_not_matter():
    rng = np.random.default_rng(42)
    parameters, state = shell(rng), ball_state(rng)
    masses = scheduled_ball(rng).point_masses[:3]
    rates = [
        rate_of(jaxball.Ball(**parameters, masses=[masses[k] for k in order]), jnp.asarray(0.3), state)
        for order in ((0, 1, 2), (2, 0, 1))
    ]
    np.testing.assert_allclose(rates[0].Omega, rates[1].Omega, rtol=1e-13, atol=1e-14)


def test_two_equal_masses_may_change_places():
    rng = np.random.default_rng(43)
    parameters, state = shell(rng), ball_state(rng)
    rail = jaxball.Circle(0.7, frame=jaxball.SphericalFrame(0.3, 0.4))
    angles = [(0.2, 1.5), (1.9, -0.4)]
    rates = []
    for order in (angles, angles[::-1]):
        motions = [jaxball.OnRail(rail, jaxball.ConstantRate(*angle)) for angle in order]
        ball = jaxball.Ball(**parameters, masses=[jaxball.PointMass(0.6, motion) for motion in motions])
        rates.append(rate_of(ball, jnp.asarray(0.3), state))
    np.testing.assert_allclose(rates[0].Omega, rates[1].Omega, rtol=1e-14, atol=1e-15)


def test_a_mass_of_nothing_changes_nothing():
    rng = np.random.default_rng(44)
    parameters, state = shell(rng), ball_state(rng)
    rail = jaxball.Circle(0.7)
    real = jaxball.PointMass(0.6, jaxball.OnRail(rail, jaxball.ConstantRate(0.2, 1.5)))
    ghost = jaxball.PointMass(0.0, jaxball.OnRail(rail, jaxball.ConstantRate(1.0, -3.0)))
    with_ghost = rate_of(jaxball.Ball(**parameters, masses=[real, ghost]), jnp.asarray(0.3), state)
    without = rate_of(jaxball.Ball(**parameters, masses=[real]), jnp.asarray(0.3), state)
    np.testing.assert_allclose(with_ghost.Omega, without.Omega, rtol=1e-14, atol=1e-15)


@pytest.mark.thorough
def test_a_static_ball_runs_back_the_way_it_came():
    """Tolerances of 1e-12 there and back: the start is found again to some hundred times that."""
    ball = jaxball.Ball(mass=1.0, inertia=(0.5, 0.6, 0.7), offset=(0.1, 0.05, -0.2))
    start = jaxball.BallState(Omega=[0.4, -0.3, 0.8])
    times, tolerances = np.array([0.0, 5.0]), {"rtol": 1e-12, "atol": 1e-12}
    end = jax.tree.map(lambda leaf: leaf[-1], jaxball.simulate(ball, times, start, **tolerances).state)
    reversed_end = eqx.tree_at(lambda x: x.Omega, end, -end.Omega)
    back = jax.tree.map(lambda leaf: leaf[-1], jaxball.simulate(ball, times, reversed_end, **tolerances).state)
    assert np.max(np.abs(end.z)) > 0.5
    np.testing.assert_allclose(back.q, start.q, atol=1e-10)
    np.testing.assert_allclose(back.Omega, -start.Omega, atol=1e-10)
    np.testing.assert_allclose(back.z, start.z, atol=1e-10)


@pytest.mark.thorough
@pytest.mark.parametrize("k", [0.25, 3.0])
def test_froude_scaling_of_lengths_and_times(k):
    """Lengths times k and times times √k, at one g, give one motion on another scale."""

    def ball(length, time):
        rail = jaxball.Ellipse(
            [0.6 * length, 0.8 * length],
            length * np.array([0.1, 0.0, -0.1]),
            jaxball.SphericalFrame(0.3, 0.4),
        )
        schedule = jaxball.Sinusoids(0.4, [0.8], [1.3 / time], [0.2], 0.5 / time)
        return jaxball.Ball(
            mass=1.4,
            inertia=length**2 * np.array([0.5, 0.6, 0.7]),
            radius=length,
            offset=length * np.array([0.1, 0.05, -0.2]),
            gravity=9.8,
            masses=[jaxball.PointMass(0.5, jaxball.OnRail(rail, schedule))],
        )

    q, Omega, t = np.array([0.5, -0.5, 0.1, 0.7]), np.array([0.3, -1.1, 0.8]), 0.7
    q /= np.linalg.norm(q)
    time = np.sqrt(k)
    one = rate_of(ball(1.0, 1.0), jnp.asarray(t), jaxball.BallState(q, Omega))
    other = rate_of(ball(k, time), jnp.asarray(t * time), jaxball.BallState(q, Omega / time))
    np.testing.assert_allclose(other.Omega * k, one.Omega, rtol=1e-13)
    np.testing.assert_allclose(other.q * time, one.q, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(other.z / time, one.z, rtol=1e-13)
