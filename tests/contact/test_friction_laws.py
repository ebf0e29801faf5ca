"""Coefficients of friction that depend on the slip speed: against a closed form, and against a constant coefficient."""

import dataclasses

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from jaxball import Ball, BallState, Contact, Ground, simulate
from jaxball.physics import AbstractFriction, ReleasedState, SmoothedCoulomb
from jaxball.physics.conditions import Condition
from tests.support.sentences import refuses

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


class Fading(AbstractFriction):
    """μ(v) = fast v / (v + half), as a user writes it."""

    fast: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    half: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    def __call__(self, speed):
        return self.fast * speed / (speed + self.half)


def slipping(start, law, times=TIMES, angle=0.0, **settings):
    """A run on a slope or on a level plane, with as many times: one program for each law."""
    ball = Ball(mass=M, inertia=(D, D, D), radius=R, gravity=G, ground=Ground(angle))
    return simulate(ball, times, start, contact=law, rtol=1e-12, atol=1e-12, **settings)


def slips_of(run):
    """v_s of a ball at the saved times, from the state alone."""
    omega = np.einsum("tij,tj->ti", run.state.Lambda, run.state.Omega)
    return np.asarray(run.contact.V)[:, :2] - R * np.stack([omega[:, 1], -omega[:, 0]], axis=1)


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
    slip = slips_of(run)
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
    assert float(Contact(Growing(0.1, 0.3)).static_friction) == float(Contact(Growing(0.1, 0.3)).friction) == 0.1
    assert float(Contact(Growing(0.1, 0.3)).coefficient(jnp.asarray(2.0))) == pytest.approx(0.7)
    with refuses(ValueError, "static_friction"):
        Contact(Growing(0.1, 0.3), static_friction=0.05)
    with refuses(ValueError, "slope"):
        Contact(Growing(0.1, -1.0))


def test_a_law_with_a_change_keeps_its_friction():
    friction = Growing(0.2, 0.1)
    assert dataclasses.replace(Contact(friction, restitution=0.1), restitution=0.6).friction_or_law is friction


MU, SMOOTHING = 0.1, 0.05
DECAY = MU * G * (1 + M * R**2 / D)  # of the speed of a fast slip, per time
ALONG_AND_ACROSS = ReleasedState(BallState(Omega=(0.3, -1.0, 0.2)), V=(1.4, 0.5, 0.0))


def test_smoothed_friction_lets_a_slip_fade():
    """v̇ = −κ v / (v + ε), so that v + ε ln v = v0 + ε ln v0 − κ t, and the slip keeps its direction and has no end.

    Where v is small its relative error is that of ln v, so the slip is compared in times.
    """
    run = slipping(ALONG_AND_ACROSS, Contact(SmoothedCoulomb(MU, SMOOTHING)), throw=True)
    slip = slips_of(run)
    speed = np.linalg.norm(slip, axis=1)
    times = (speed[0] - speed + SMOOTHING * np.log(speed[0] / speed)) / DECAY
    np.testing.assert_allclose(times, TIMES, rtol=0, atol=1e-10)
    np.testing.assert_allclose(slip, speed[:, None] * slip[0] / speed[0], rtol=0, atol=1e-11)
    assert int(run.contact.switches.count) == 0
    own = slipping(ALONG_AND_ACROSS, Contact(Fading(MU, SMOOTHING)), throw=True)
    np.testing.assert_allclose(run.state.Omega, own.state.Omega, rtol=0, atol=1e-11)


def test_a_slip_that_has_faded_costs_few_steps():
    """Of the time 60 the slip lasts 5: what rounding leaves of it has no ends to be found."""
    run = slipping(ALONG_AND_ACROSS, Contact(SmoothedCoulomb(MU, SMOOTHING)), 15 * TIMES, throw=True)
    assert int(run.steps) < 1000
    np.testing.assert_allclose(slips_of(run)[-1], 0.0, atol=1e-9)


@pytest.mark.parametrize("start", [BallState(), ReleasedState(BallState())], ids=["rolling", "released"])
def test_smoothed_friction_lets_a_ball_creep_on_a_slope(start):
    """Rolling would need the share s = tan a / (μ (1 + m r²/d)) of μ N, which the slip ε s / (1 − s) has."""
    a = 0.03
    run = slipping(start, Contact(SmoothedCoulomb(MU, SMOOTHING)), angle=a, throw=True)
    share = np.tan(a) / (MU * (1 + M * R**2 / D))
    np.testing.assert_allclose(slips_of(run)[-1], [SMOOTHING * share / (1 - share), 0.0], rtol=0, atol=1e-9)


@pytest.mark.long
def test_the_derivative_of_a_slip_that_does_not_yet_slip():
    """δv = exp(−κ t / ε) δv0 where friction fades; the part d / (d + m r²) of it is the velocity of the centre.

    The ball spins about the vertical, which changes nothing but the length of the steps.
    """
    spun = BallState(Omega=(0.0, 0.0, 40.0))

    def velocity(speed):
        start = ReleasedState(spun, V=jnp.stack([speed, jnp.zeros(()), jnp.zeros(())]))
        return slipping(start, Contact(SmoothedCoulomb(MU, SMOOTHING))).contact.V[:4, 0]

    lost = (1 - np.exp(-DECAY / SMOOTHING * TIMES[:4])) * D / (D + M * R**2)
    np.testing.assert_allclose(jax.jacfwd(velocity)(jnp.zeros(())), 1 - lost, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_derivatives_by_the_numbers_of_smoothed_friction():
    """By the implicit function: (1 + ε/v) dv = (ln v0/v) dε − t κ/μ dμ, in both modes."""

    def speed(law):
        start = ReleasedState(BallState(), V=(1.4, 0.0, 0.0))
        run = slipping(start, Contact(law))
        return run.contact.V[10, 0] - R * run.state.Omega[10, 1]

    law = SmoothedCoulomb(MU, SMOOTHING)
    v = float(speed(law))
    by_kinetic = -TIMES[10] * DECAY / MU / (1 + SMOOTHING / v)
    by_smoothing = np.log(1.4 / v) / (1 + SMOOTHING / v)
    for derivative in (jax.jacfwd(speed)(law), jax.grad(speed)(law)):
        np.testing.assert_allclose(derivative.kinetic, by_kinetic, rtol=0, atol=1e-9)
        np.testing.assert_allclose(derivative.smoothing, by_smoothing, rtol=0, atol=1e-9)


def test_the_coefficients_of_smoothed_friction():
    """Half of the fast slip's friction at the speed `smoothing`, and none without slip."""
    contact = Contact(SmoothedCoulomb(0.3, 0.02))
    assert float(contact.coefficient(jnp.asarray(0.02))) == 0.15
    assert float(contact.friction) == float(contact.static_friction) == 0.0
    with refuses(ValueError, "friction.kinetic"):
        Contact(SmoothedCoulomb(-0.3, 0.02))
    with refuses(ValueError, "friction.smoothing"):
        Contact(SmoothedCoulomb(0.3, 0.0))
