"""Forces on joints: limits, sums, and the part whose integral is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball

STEPS = jaxball.PiecewiseSignal([0.0, 1.0, 2.5], [0.5, -2.0])
RAMPS = jaxball.PiecewiseSignal([0.0, 1.0, 2.5], [[0.5, 1.0], [-2.0, 0.3]])
STATE = jaxball.BallState()


def force_at(force, t, theta=0.0, thetadot=0.0):
    return float(force(jnp.array(t), jnp.array(theta), jnp.array(thetadot), STATE))


NODES, WEIGHTS = np.polynomial.legendre.leggauss(5)


@pytest.mark.parametrize("signal", [STEPS, RAMPS], ids=["steps", "ramps"])
@pytest.mark.parametrize("prepared", [False, True])
def test_the_impulse_is_the_integral_of_the_signal(signal, prepared):
    signal = signal.prepare() if prepared else signal
    for t in (-0.5, 0.4, 1.0, 1.7, 2.5, 3.0):
        pieces = np.clip([-0.5, 0.0, 1.0, 2.5, t], None, t)
        middles, halves = (pieces[1:] + pieces[:-1])[:, None] / 2, np.diff(pieces)[:, None] / 2
        values = jax.vmap(signal)(jnp.ravel(middles + halves * NODES)).reshape(4, 5)
        integral = np.sum(halves * WEIGHTS * values)  # Gauss's rule is exact in each piece
        np.testing.assert_allclose(float(signal.impulse(jnp.array(t))), integral, rtol=0, atol=1e-12)


@pytest.mark.thorough
def test_what_is_integrated_and_what_is_not_make_up_the_force():
    motor = jaxball.Motor(STEPS)
    force = motor + jaxball.Spring(2.0) + jaxball.Motor(RAMPS, limit=1.0)
    now = jnp.array(0.5), jnp.array(0.3), jnp.array(0.1), STATE
    whole, rest = float(force(*now)), float(force.without_impulse(*now))
    assert whole == pytest.approx(0.5 - 0.6 + 1.0)
    assert rest == pytest.approx(whole - 0.5)
    assert float(force.impulse(jnp.array(0.5))) == 0.25
    # Ramps within a limit have no closed form here: their jumps are among those of forces that drive.
    assert force.motion_kinks().tolist() == [0.0, 1.0, 2.5]
    assert force.kinks().tolist() == [0.0, 1.0, 2.5]


def test_steps_within_a_limit_are_lower_steps():
    motor = jaxball.Motor(STEPS, limit=1.0)
    assert [force_at(motor, t) for t in (0.5, 1.5, 3.0)] == [0.5, -1.0, 0.0]
    limited = motor.prepare()
    assert [force_at(limited, t) for t in (0.5, 1.5, 3.0)] == [0.5, -1.0, 0.0]
    assert float(limited.impulse(jnp.array(2.0))) == pytest.approx(0.5 - 1.0)
    assert motor.kinks().size == 0
    assert motor.motion_kinks().tolist() == [0.0, 1.0, 2.5]


def test_a_servo_gives_no_more_than_its_limit():
    servo = jaxball.PDServo(jaxball.ConstantRate(1.0, rate=0.5), stiffness=4.0, damping=2.0, limit=1.5)
    assert force_at(servo, 0.0, theta=0.9, thetadot=0.4) == pytest.approx(4.0 * 0.1 + 2.0 * 0.1)
    assert force_at(servo, 0.0, theta=-1.0) == 1.5


def test_end_stops_never_pull():
    stops = jaxball.EndStops(-1.0, 0.5, stiffness=10.0, damping=2.0)
    assert force_at(stops, 0.0, theta=0.2, thetadot=3.0) == 0.0
    assert force_at(stops, 0.0, theta=0.7, thetadot=0.1) == pytest.approx(-10.0 * 0.2 * 1.2)
    assert force_at(stops, 0.0, theta=0.7, thetadot=-5.0) == 0.0  # it leaves faster than the stop pushes
    assert force_at(stops, 0.0, theta=-1.2, thetadot=-0.1) == pytest.approx(10.0 * 0.2 * 1.2)
