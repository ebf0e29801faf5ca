"""Coefficients of friction that depend on the slip speed: against a closed form, and against a constant coefficient."""

import dataclasses

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxball import AbstractFriction, Ball, BallState, Contact, Ground, ReleasedState, simulate
from jaxball.physics.conditions import Condition

M, D, R, G = 1.3, 0.6, 0.9, 2.0
TIMES = np.linspace(0.0, 4.0, 41)


class Growing(AbstractFriction):
    """μ(v) = least + slope v."""

    least: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    slope: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    def __call__(self, speed):
        return self.least + self.slope * speed

    def conditions(self):
        yield Condition(self.slope >= 0, "contact.slope", self.slope, "0 or positive")


def slipping(start, law, **settings):
    ball = Ball(mass=M, inertia=(D, D, D), radius=R, gravity=G)
    return simulate(ball, TIMES, start, contact=law, rtol=1e-12, atol=1e-12, **settings)


@pytest.mark.parametrize(
    "start",
    [
        ReleasedState(BallState(), V=(1.4, 0.0, 0.0)),
        pytest.param(ReleasedState(BallState(Omega=(0.3, -1.0, 0.2)), V=(1.4, 0.5, 0.0)), marks=pytest.mark.thorough),
    ],
    ids=["along", "across"],
)
def test_friction_that_grows_with_the_speed_stops_a_slip_as_an_exponential(start):
    """v̇ = −κ (μ + c v) with κ = g (1 + m r²/d), so that v = (v0 + μ/c) exp(−κ c t) − μ/c until it is 0."""
    mu, c = 0.1, 0.05
    run = slipping(start, Contact(Growing(mu, c)), throw=True)
    omega = np.einsum("tij,tj->ti", run.state.Lambda, run.state.Omega)
    slip = np.asarray(run.contact.V)[:, :2] - R * np.stack([omega[:, 1], -omega[:, 0]], axis=1)
    v0, rate = np.linalg.norm(slip[0]), c * G * (1 + M * R**2 / D)
    speed = np.maximum((v0 + mu / c) * np.exp(-rate * TIMES) - mu / c, 0.0)
    np.testing.assert_allclose(slip, speed[:, None] * slip[0] / v0, rtol=0, atol=1e-11)
    assert int(run.contact.switches.count) == 1
    np.testing.assert_allclose(run.contact.switches.times[0], np.log(1 + c * v0 / mu) / rate, rtol=0, atol=1e-11)
    lost = 0.5 * v0**2 / (1 / M + R**2 / D)  # of the motion of the lowest point, whose mass is 1 / (1/m + r²/d)
    np.testing.assert_allclose(run.contact.friction_loss[-1], lost, rtol=0, atol=1e-11)


@pytest.mark.slow
def test_derivatives_by_the_numbers_of_a_law():
    """∂v/∂c of the closed form at t = 0.4, before the slip ends."""
    mu, c, v0 = 0.1, 0.05, 1.4
    kappa = G * (1 + M * R**2 / D)

    def speed(c):
        start = ReleasedState(BallState(), V=(v0, 0.0, 0.0))
        run = slipping(start, Contact(Growing(mu, c)), adjoint=diffrax.ForwardMode())
        return run.contact.V[4, 0] - R * run.state.Omega[4, 1]

    def closed(c):
        return (v0 + mu / c) * jnp.exp(-kappa * c * TIMES[4]) - mu / c

    np.testing.assert_allclose(jax.jacfwd(speed)(jnp.asarray(c)), jax.jacfwd(closed)(c), rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_law_that_does_not_depend_on_the_speed_is_a_coefficient():
    """Where nothing is isotropic, through slips that begin and end, on a slope: the same run."""
    ball = Ball(mass=M, inertia=(0.5, 0.6, 0.7), offset=(0.1, 0.0, -0.2), radius=R, gravity=G, ground=Ground(0.3, 0.2))
    start = ReleasedState(BallState(Omega=(0.3, -1.0, 0.2)), V=(1.4, 0.5, 0.0), height=0.05)
    one, other = (
        simulate(ball, TIMES, start, contact=Contact(law, restitution=0.4), throw=True, rtol=1e-10, atol=1e-10)
        for law in (0.1, Growing(0.1, 0.0))
    )
    assert int(one.contact.switches.count) == int(other.contact.switches.count) > 2
    losses = one.contact.friction_loss, other.contact.friction_loss
    for found, expected in ((one.state.Omega, other.state.Omega), losses):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)


def test_the_coefficients_of_a_law():
    """Static friction is μ(0) unless it is given, and must not be less."""
    assert float(Contact(Growing(0.1, 0.3)).static) == float(Contact(Growing(0.1, 0.3)).sliding) == 0.1
    assert float(Contact(Growing(0.1, 0.3)).coefficient(jnp.asarray(2.0))) == pytest.approx(0.7)
    with pytest.raises(ValueError, match=r"`static` must be no less than the coefficient `sliding`"):
        Contact(Growing(0.1, 0.3), static=0.05)
    with pytest.raises(ValueError, match=r"`slope` must be 0 or positive, but it is -1"):
        Contact(Growing(0.1, -1.0))


def test_a_law_with_a_change_keeps_its_friction():
    friction = Growing(0.2, 0.1)
    assert dataclasses.replace(Contact(friction, restitution=0.1), restitution=0.6).law_of_sliding is friction
