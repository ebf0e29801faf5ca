"""A law linear in the state, against the same law as a function, and what it refuses."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Accelerated, BallState, DiskState, LinearLaw, Sinusoids
from jaxball.physics import ReducedState, RotationState
from tests.support.sentences import refuses

THETA, THETADOT = np.array([[-4.0, 0.5], [0.2, -3.0]]), np.array([[-1.0, 0.0], [0.1, -2.0]])
OMEGA, GAMMA = np.array([[0.1, 0.2, 0.3], [0.0, -0.1, 0.4]]), np.array([[0.5, 0.0, 0.1], [0.0, 0.3, -0.2]])
PLACE = np.array([[0.2, -0.1], [0.3, 0.1]])
STEPS = jaxball.PiecewiseSignal([0.3, 0.6], [0.7])
LAW = LinearLaw(THETA, THETADOT, OMEGA, GAMMA, PLACE, [STEPS, Sinusoids(0.1, [0.2], [3.0])])


def by_hand(t, state, _):
    signals = jnp.stack([jnp.where((t >= 0.3) & (t < 0.6), 0.7, 0.0), 0.1 + 0.2 * jnp.sin(3.0 * t)])
    products = [
        jnp.sum(matrix * getattr(state, name)[None], axis=1)
        for name, matrix in (("theta", THETA), ("thetadot", THETADOT), ("Omega", OMEGA), ("Gamma", GAMMA), ("z", PLACE))
    ]
    return signals + sum(products)


def ball(law):
    masses = [jaxball.PointMass(0.2, jaxball.Driven(jaxball.Circle(radius))) for radius in (0.4, 0.6)]
    return jaxball.Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), masses=masses, law=law)


def with_an_arm(law):
    joint, carried = jaxball.Hinge((0.0, 1.0, 0.0), drive=Accelerated()), jaxball.CarriedMass(0.3, (0.0, 0.0, -0.5))
    mass = jaxball.PointMass(0.2, jaxball.Driven(jaxball.Circle(0.6)))
    arm = jaxball.Mechanism([joint], [carried])
    return jaxball.Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), masses=[mass], mechanisms=[arm], law=law)


@pytest.mark.long
def test_a_run_is_that_of_the_same_function():
    times, state = jnp.linspace(0.0, 1.0, 5), BallState(Omega=(0.1, 0.2, 0.3), theta=(0.2, -0.1), thetadot=(0.0, 0.1))
    runs = [
        jaxball.simulate(ball(law), times, state, rtol=1e-10, atol=1e-10)
        for law in (LAW, jaxball.FunctionLaw(by_hand, kink_times=(0.3, 0.6)))
    ]
    assert all(run.ok for run in runs)
    for name in ("theta", "thetadot", "Omega", "z"):
        ours, theirs = (getattr(run.state, name) for run in runs)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_joints_have_rows_after_the_masses():
    state = BallState(theta=(0.2, -0.1), thetadot=(0.0, 0.1))
    rates = jaxball.physics.vector_field(with_an_arm(LinearLaw(signals=[0.25, -0.5])), jnp.array(0.0), state)
    np.testing.assert_array_equal(rates.thetadot, [0.25, -0.5])


def test_its_kinks_are_those_of_the_signals():
    np.testing.assert_array_equal(LAW.kinks(), [0.3, 0.6])
    assert LinearLaw(theta=THETA).kinks().shape == (0,)


def test_a_disk_has_one_number_for_its_place():
    law = LinearLaw(Omega=[[0.0, 2.0, 0.0]], z=[[3.0]])
    assert float(law(jnp.array(0.0), DiskState(phidot=-0.5, z=0.25))[0]) == 2.0 * 0.5 + 3.0 * 0.25


def test_omega_is_in_space_axes():
    """ω = ΛΩ: of a ball that is turned by a right angle about e3, Ω along E1 is ω along e2."""
    turned = BallState(q=(np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)), Omega=(0.3, 0.0, 0.2))
    law = LinearLaw(omega=[[1.0, 2.0, 4.0]])
    np.testing.assert_allclose(law(jnp.array(0.0), turned), [2 * 0.3 + 4 * 0.2], rtol=1e-12)
    np.testing.assert_allclose(law(jnp.array(0.0), DiskState(phi=0.4, phidot=-0.5)), [2 * 0.5], rtol=1e-12)
    with refuses(TypeError, "omega"):
        law(jnp.array(0.0), turned.reduce())


def test_states_without_versors():
    at = {"Omega": (0.1, 0.2, 0.3), "theta": (0.1, 0.2), "thetadot": (0.3, 0.4)}
    expected = LAW(jnp.array(0.4), BallState(**at, z=(1.0, 2.0)))
    np.testing.assert_allclose(LAW(jnp.array(0.4), RotationState(**at, z=(1.0, 2.0))), expected, rtol=1e-15)
    with refuses(TypeError, "z"):
        LAW(jnp.array(0.4), BallState(**at).reduce())
    assert LinearLaw(Gamma=GAMMA)(jnp.array(0.0), ReducedState(**at, Gamma=(0.0, 0.0, 1.0))).shape == (2,)


def test_what_does_not_fit():
    with refuses(ValueError, "theta"):
        LinearLaw(theta=THETA, signals=[1.0])
    with refuses(ValueError, "theta"):
        LinearLaw()
    with refuses(ValueError, "Gamma"):
        LinearLaw(Gamma=[[1.0, 2.0]])
    with refuses(ValueError, "theta"):
        ball(LinearLaw(theta=[[1.0, 2.0]]))
    with refuses(TypeError, "signals[0]"):
        LinearLaw(signals=["text"])
    with refuses(ValueError, "theta"):
        LinearLaw(theta=[[1.0]])(jnp.array(0.0), BallState(theta=(0.1, 0.2), thetadot=(0.0, 0.0)))
