"""A filter of a robot that rests or strikes stops carries its covariance as the derivative of the motion does."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Contact, Disk, DiskState, HardStops, Resistance, ring_rotor
from jaxball.control.estimation import ErrorStateFilter
from jaxball.control.sampled import SampledSystem
from jaxball.physics.sensors import Gyroscope, SensorErrors
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


def test_a_law_of_contact_is_refused():
    sampled = SampledSystem.without_inputs(Disk(mass=1.0, inertia=0.5), 0.1)
    with refuses(ValueError, "sampled"):
        ErrorStateFilter.for_sampled_system(dataclasses.replace(sampled, contact=Contact(0.3)), SENSORS)
