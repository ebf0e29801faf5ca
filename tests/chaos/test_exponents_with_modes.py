"""Lyapunov exponents of runs whose modes change: their sums and single values in closed form, and multipliers."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxball import Contact, Disk, DiskState, Ground, HarmonicSeries, Oscillating, Resistance, simulate
from jaxball.analysis.chaos import chart, lyapunov_spectrum
from jaxball.analysis.stability import periodic_motion
from jaxball.physics import ReleasedState
from jaxball.physics.classical import DryFriction, LagrangianState, LagrangianSystem
from tests.hybrid.test_systems import Bouncing, Moving
from tests.support.sentences import refuses
from tests.support.struck_oscillator import struck_oscillator

G = 9.81


def on_oscillating_ground(amplitude: float, rate: float) -> Disk:
    path = HarmonicSeries(jnp.zeros(3), amplitude * jnp.eye(3)[2:], jnp.array([rate]))
    return Disk(mass=1.0, inertia=0.4, gravity=G, ground=Ground(motion=Oscillating(path)))


@pytest.mark.thorough
def test_a_disk_that_bounces_chaotically():
    """Only strikes contract, each by e² in height and speed, so that exponents have a sum that the strikes tell."""
    e, start, transient, end = 0.8, ReleasedState(DiskState(), V=(0.0, 0.0, 2.0), height=0.5), 2.0, 27.0
    # Not longer: in chaos two runs that differ by rounding strike differently often after a while.
    law, disk = Contact(friction=0.3, restitution=e, capacity=128), on_oscillating_ground(0.45, 7.0)
    tight = {"rtol": 1e-10, "atol": 1e-10}
    found = lyapunov_spectrum(disk, (0.0, end), start, contact=law, interval=0.5, transient=transient, **tight)
    assert found.ok
    run = simulate(disk, [0.0, transient], start, contact=law, **tight)
    middle = ReleasedState(DiskState(), run.contact.V[-1], run.contact.height[-1])
    strikes = int(simulate(disk, [transient, end], middle, contact=law, **tight).contact.switches.count)
    exponents = np.asarray(found.exponents)
    # A slip ends at the first strike, and nothing is left of it.
    assert np.isneginf(exponents[-1])
    np.testing.assert_allclose(np.sum(exponents[:-1]), 2 * np.log(e) * strikes / (end - transient), rtol=1e-6)
    # φ, z and the speed of rolling are neutral.
    assert exponents[0] > 0.3
    np.testing.assert_allclose(exponents[1:4], 0.0, atol=0.1)
    assert 4 < found.dimension < 5


@pytest.mark.thorough
def test_exponents_of_an_oscillator_that_strikes_a_wall_are_those_of_its_multipliers():
    damping, rate, e = 0.1, 2.4, 0.8
    system = struck_oscillator(damping, rate, e)
    period = 2 * np.pi / rate
    motion = periodic_motion(system, LagrangianState([0.09], [0.78]), period)
    found = lyapunov_spectrum(system, (0.0, 200 * period), motion.state, interval=period, transient=10 * period)
    assert found.ok
    # A complex pair turns deviations, whose rates have a mean.
    np.testing.assert_allclose(found.exponents, motion.exponents.real, atol=2e-3)
    np.testing.assert_allclose(np.sum(found.exponents), np.sum(motion.exponents.real), rtol=1e-7)


@pytest.mark.thorough
def test_a_block_on_a_belt_forgets_its_start():
    system = LagrangianSystem(
        lambda t, q, qdot: 0.5 * qdot[0] ** 2 - 0.5 * q[0] ** 2,
        ("x",),
        dry=DryFriction(lambda t, q, qdot: qdot[0] - 0.3, level=0.5, static=1.0),
    )
    found = lyapunov_spectrum(system, (0.0, 100.0), LagrangianState([0.3], [-0.3]))
    assert abs(found.exponents[0]) < 0.03  # along the motion
    assert np.isneginf(found.exponents[1])
    assert found.standard_error[1] == 0
    assert found.told_from_zero.tolist() == [False, True]
    assert "λ2 = -inf" in str(found)


@pytest.mark.thorough
def test_a_disk_that_dry_resistance_stops():
    """At rest for good, no deviation of the velocity is left, and those of the place stay as they are."""
    disk = Disk(mass=1.0, inertia=0.4, gravity=G, resistance=Resistance(dry=0.05, exact=True))
    found = lyapunov_spectrum(disk, (0.0, 20.0), DiskState(phidot=-1.0), transient=5.0)
    assert found.ok
    np.testing.assert_allclose(found.exponents, [0.0, 0.0, -np.inf], atol=1e-12)
    np.testing.assert_allclose(found.least_normal_force, G, rtol=1e-9)
    labels = [line.get_label() for line in found.plot().get_lines()]
    assert labels[:3] == [r"$\lambda_1$", r"$\lambda_2$", r"$\lambda_3 = -\infty$"]


def test_a_state_that_says_its_mode_is_refused():
    with refuses(TypeError, "system"):
        lyapunov_spectrum(Bouncing(), (0.0, 4.0), Moving())


def test_charts_are_of_smooth_systems():
    def make(a, b):
        return Disk(mass=1.0, inertia=0.4, resistance=Resistance(dry=a, exact=True)), DiskState(phidot=b)

    with refuses(TypeError, "system"):
        chart(make, {"a": [0.1], "b": [1.0]}, (0.0, 4.0))
