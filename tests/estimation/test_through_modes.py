"""A filter of a robot that rests or strikes stops carries its covariance as the derivative of the motion does."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Ball, BallState, Contact, Disk, DiskState, HardStops, Resistance, ring_rotor, simulate
from jaxball.control.estimation import ErrorStateFilter, chi2_bounds
from jaxball.physics import ReleasedState
from jaxball.physics.contact.slipping import SlippingState
from jaxball.physics.sensors import Gyroscope, Position, SensorErrors
from tests.support.sentences import refuses

SENSORS = {"gyro": Gyroscope(errors=SensorErrors(noise=0.1))}
SPREAD = {"phi": 0.2, "phidot": 0.05, "z": 0.1, "theta": 0.01, "thetadot": 0.02}
UNREAD = {"gyro": jnp.full((2, 3), jnp.nan)}


def predict(disk, start, sample):
    """The derivative of the errors over a sample, and their covariance after it, of a filter that reads nothing."""
    known = ErrorStateFilter.of(disk, SENSORS, sample)
    spread = {name: SPREAD[name.partition("[")[0]] for name in start.directions}
    found = known(UNREAD, start, spread)
    return np.asarray(found.filtered.F[0]), np.asarray(found.covariance[1])


@pytest.mark.long
def test_a_strike_of_a_wheel_is_that_of_saltation():
    """Nothing acts on the wheel: θ = θₛ − e θ̇₀ (T − t*) after the strike at t* = (θₛ − θ₀) / θ̇₀."""
    e, sample = 0.5, 0.4
    wheel = ring_rotor(0.3, 0.4, axis=(0.0, 1.0, 0.0), drive=HardStops(-0.2, 0.2, e))
    disk = Disk(mass=1.0, inertia=0.5, mechanisms=[wheel])
    F, P = predict(disk, DiskState(phidot=-0.3, theta=(0.1,), thetadot=(0.5,)), sample)
    np.testing.assert_allclose(F[3:, 3:], [[-e, -e * sample], [0.0, -e]], rtol=0, atol=1e-7)
    before = np.diag([SPREAD["theta"] ** 2, SPREAD["thetadot"] ** 2])
    np.testing.assert_allclose(P[3:, 3:], F[3:, 3:] @ before @ F[3:, 3:].T, rtol=0, atol=1e-10)


@pytest.mark.long
def test_nothing_is_left_to_doubt_of_the_rate_of_a_disk_that_comes_to_rest():
    """φ̇ falls at the rate a = ρ N / (m r² + d), so that it rests where φ = φ₀ + φ̇₀² / (2 a)."""
    rho, rate = 0.2, 0.3
    disk = Disk(mass=1.0, inertia=0.5, gravity=1.0, resistance=Resistance(dry=rho, exact=True))
    F, P = predict(disk, DiskState(phidot=rate), 4.0)
    slope = rate / (rho / 1.5)
    np.testing.assert_allclose(F, [[1.0, slope, 0.0], [0.0, 0.0, 0.0], [0.0, -slope, 1.0]], rtol=0, atol=1e-6)
    assert P[1, 1] == pytest.approx(0.0, abs=1e-12)
    assert P[0, 0] == pytest.approx(SPREAD["phi"] ** 2 + (slope * SPREAD["phidot"]) ** 2, rel=1e-6)


ICE = Contact(friction=0.1, restitution=0.5)


@pytest.mark.long
def test_an_impact_is_that_of_saltation():
    """A disk falls for t* until it strikes the ground at the speed w = g t* − v₀, and rises with e w."""
    g, e, v0, height, sample = 1.0, 0.5, -0.3, 0.08, 0.4
    disk = Disk(mass=1.0, inertia=0.5, gravity=g)
    known = ErrorStateFilter.of(disk, SENSORS, sample, contact=Contact(friction=0.0, restitution=e))
    start = ReleasedState(DiskState(), V=(0.5, 0.0, v0), height=height)
    found = known(UNREAD, start, {"rise": 0.02, "height": 0.01})
    strikes = (v0 + np.sqrt(v0**2 + 2 * g * height)) / g
    w, left = g * strikes - v0, sample - strikes
    # By v₀ and the height: ∂w/∂v₀ = g t*/w − 1, ∂w/∂h₀ = g/w, and the remaining time is shorter by t*/w and 1/w.
    by_start = np.array([[g * strikes / w - 1, strikes / w], [g / w, 1 / w]])
    rise = [e * dw + g * dt for dw, dt in by_start]
    above = [e * left * dw - (e * w - g * left) * dt for dw, dt in by_start]
    F = np.asarray(found.filtered.F[0])[-2:, -2:]
    np.testing.assert_allclose(F, [rise, above], rtol=0, atol=1e-8)
    P = F @ np.diag([0.02**2, 0.01**2]) @ F.T
    np.testing.assert_allclose(found.covariance[1][-2:, -2:], P, rtol=0, atol=1e-12)
    truth = known.truth(simulate(disk, [0.0, sample], start, contact=known.sampled.contact))
    np.testing.assert_allclose(found.errors(truth), 0.0, atol=1e-9)
    assert found.state.rise[1] == pytest.approx(e * w - g * left, abs=1e-9)


@pytest.mark.long
def test_of_a_slip_that_ends_only_what_it_gave_to_the_rolling_remains_in_doubt():
    """L = (m r² + d) ω about the contact keeps m r s₀ of the slip, so that ω = ω₀ + s₀ m r / (m r² + d) after it."""
    disk = Disk(mass=1.0, inertia=0.5, gravity=1.0)
    start = ReleasedState(DiskState(phidot=-0.3), V=(0.35, 0.0, 0.0))
    known = ErrorStateFilter.of(disk, SENSORS, 1.0, contact=ICE)
    found = known(UNREAD, start, {"phidot": 0.01, "slip": 0.02})
    names = found.directions
    assert names == ("phi", "phidot", "z", "slip[0]", "rise", "height")
    of_rate, of_slip = names.index("phidot"), names.index("slip[0]")
    F = np.asarray(found.filtered.F[0])
    np.testing.assert_allclose(F[of_rate, [of_rate, of_slip]], [1.0, -1 / 1.5], rtol=0, atol=1e-9)
    assert np.all(F[of_slip:] == 0)
    assert found.deviations["slip[0]"][1] == 0.0
    assert found.state.slip[1] == 0.0
    assert found.deviations["phidot"][1] == pytest.approx(np.hypot(0.01, 0.02 / 1.5), rel=1e-9)


@pytest.mark.long
def test_a_body_that_only_rolls_is_estimated_as_without_a_law():
    ball = Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), offset=(0.0, 0.0, -0.1))
    start = BallState(Omega=(0.1, 0.3, 0.2))
    readings = simulate(ball, jnp.linspace(0.0, 0.6, 4), start).measured(SENSORS)
    guess, spread = BallState(Omega=(0.1, 0.2, 0.2)), {"Omega": 0.2, "attitude": 0.1}
    rolls, may_slip = (
        ErrorStateFilter.of(ball, SENSORS, 0.2, contact=law)(readings, guess, spread) for law in (None, Contact(2.0))
    )
    n = len(rolls.directions)
    np.testing.assert_allclose(may_slip.covariance[:, :n, :n], rolls.covariance, rtol=0, atol=1e-9)
    np.testing.assert_allclose(may_slip.state.body.Omega, rolls.state.Omega, rtol=0, atol=1e-9)
    np.testing.assert_allclose(may_slip.covariance[:, n:], 0.0, atol=0)
    assert float(rolls.deviations["Omega[1]"][-1]) < 0.1


@pytest.mark.long
def test_errors_of_a_thrown_ball_are_as_large_as_the_filter_says():
    """A ball thrown along the ground, with backspin: it bounces and slips, and a camera and a gyroscope see it."""
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), gravity=1.0)
    sensors = {
        "camera": Position(errors=SensorErrors(noise=0.02)),
        "gyro": Gyroscope(errors=SensorErrors(noise=0.05)),
    }
    times, law = jnp.linspace(0.0, 1.3, 14), Contact(friction=0.2, restitution=0.6)
    # It strikes the ground at 0.55 and 1.45, between samples, at which estimates and truth then have the same mode.
    guess = ReleasedState(BallState(Omega=(0.0, -1.0, 0.0)), V=(1.0, 0.2, -0.2), height=0.26125)
    known = ErrorStateFilter.of(ball, sensors, 0.1, contact=law)
    spread = {"Omega": 0.05, "z": 0.03, "slip": 0.05, "rise": 0.02, "height": 0.01}
    deviations, first = np.asarray(known.deviations(spread)), SlippingState.of(ball, jnp.asarray(0.0), guess)
    nees = []
    for seed in range(24):
        start = first.retract(deviations * np.random.default_rng(seed).standard_normal(deviations.size))
        run = simulate(ball, times, start.released(ball, jnp.asarray(0.0)), contact=law)
        found = known(run.measured(sensors, jax.random.key(seed)), guess, spread)
        nees.append(np.asarray(found.nees(known.truth(run))))
        uncertain = np.asarray(found.uncertain)
    assert int(run.switches.count) > 0
    low, high = np.transpose([chi2_bounds(int(degrees), 24, 0.999) for degrees in uncertain])
    mean = np.mean(nees, axis=0)
    assert np.all((low < mean) & (mean < high)), (low, mean, high)


def test_a_run_without_a_law_is_no_truth_for_a_filter_with_one():
    disk = Disk(mass=1.0, inertia=0.5)
    with refuses(ValueError, "run"):
        ErrorStateFilter.of(disk, SENSORS, 0.1, contact=ICE).truth(simulate(disk, [0.0, 0.1]))
