"""Modes that end by the time alone: where the state does not move, a solve takes steps over many of their ends.

The truth is a model of one number, whose events are zeros of elementary functions. Each row of a table is a frequency,
the same motion in other units of time, at all tolerances: the number of switches is that of the model in each of them.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int
from scipy.optimize import brentq

import jaxball
from jaxball import (
    Ball,
    BallState,
    Contact,
    Disk,
    DiskState,
    Ground,
    HarmonicSeries,
    JointFriction,
    Oscillating,
    Resistance,
)
from jaxball.physics import HarmonicForce, Mode, TiltingPlane
from jaxball.simulation.ensemble import simulate_ensemble

G, END = 9.81, 5.0
TOLERANCES = 10.0 ** -np.arange(3, 14)
FREQUENCIES = [1.0, 3.0, 20.0, 70.0, 200.0]
BEYOND = 1.1  # what acts, relative to what dry friction can hold
STRONG = 1.22  # the plate's largest acceleration, in g
FINE = np.linspace(0.0, END, 20_001)


def counts(system, state, tolerances=TOLERANCES, **law):
    """How many switches there are at each tolerance; every run succeeds."""
    runs = [jaxball.simulate(system, (0.0, END), state, rtol=tol, atol=tol, throw=True, **law) for tol in tolerances]
    return [int(run.switches.count) for run in runs]


# A system by the contract alone.


class Gate(jaxball.physics.AbstractState):
    x: Float[Array, "*batch"] = eqx.field(converter=jnp.asarray, default=0.0)
    mode: Int[Array, "*batch"] = eqx.field(converter=jnp.asarray, default=0)


class Gates(jaxball.AbstractSystem[Gate]):
    """It opens where sin ωt rises through a level, and closes where it falls through minus that level."""

    frequency: Float[Array, "*batch"] = eqx.field(converter=jnp.asarray)
    level: Float[Array, "*batch"] = eqx.field(converter=jnp.asarray)

    state_type: ClassVar[type[Gate]] = Gate
    max_switches: ClassVar[int] = 512

    def field(self, t, state):
        return Gate(jnp.zeros_like(state.x), jnp.zeros_like(state.mode))

    def guards(self, t, state):
        wave = jnp.sin(self.frequency * t)
        return jnp.where(state.mode == 0, self.level - wave, self.level + wave)[None]

    def reset(self, t, state, which):
        return Gate(state.x, 1 - state.mode)


@pytest.mark.parametrize("level", [0.3, 0.999999])
@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_a_system_at_rest_switches_by_the_time(frequency, level):
    """With the level 0.999999, a guard is below zero in a 2000th of a period, if nothing happens."""
    last = int((frequency * END - np.arcsin(level)) // np.pi)
    times = (np.arcsin(level) + np.pi * np.arange(last + 1)) / frequency
    for tol in TOLERANCES:
        run = jaxball.simulate(Gates(frequency, level), (0.0, END), rtol=tol, atol=tol, throw=True)
        assert int(run.switches.count) == len(times)
        # To rounding of the wave, which moves the zero by more where that is flat.
        rounding = 1e-14 * frequency * END / np.sqrt(1 - level**2) / frequency
        np.testing.assert_allclose(run.switches.times[: len(times)], times, atol=rounding + 1e-13)


def test_a_row_of_systems_at_rest():
    """Some rows end a mode while others do not."""
    systems = Gates(jnp.asarray(FREQUENCIES), jnp.full(len(FREQUENCIES), 0.3))
    rows = simulate_ensemble(systems, (0.0, END), Gate(), in_axes=(0, None))
    wanted = [int((frequency * END - np.arcsin(0.3)) // np.pi) + 1 for frequency in FREQUENCIES]
    np.testing.assert_array_equal(rows.trajectory.switches.count, wanted)


# A plate that shakes.


def shaken(frequency):
    """X₃ = a sin ωt, as large as the plate's acceleration is to be ``STRONG`` g."""
    up = [(0.0, 0.0, STRONG * G / frequency**2)]
    return Oscillating(HarmonicSeries(constant=(0.0, 0.0, 0.0), amplitude=up, frequency=[frequency]))


def lifts_and_landings(frequency):
    """When a body on the plate lifts off, where Ẍ₃ = −g, and comes down; without rebound it then stays."""

    def fallen(t, lift):
        a, since = STRONG * G / frequency**2, t - lift
        start, speed = a * np.sin(frequency * lift), a * frequency * np.cos(frequency * lift)
        return start + speed * since - 0.5 * G * since**2 - a * np.sin(frequency * t)

    times, first, period = [], np.arcsin(1 / STRONG) / frequency, 2 * np.pi / frequency
    while first < END:
        # It lands in the same period: later, the plate would have to press.
        landing = brentq(fallen, first + 0.05 * period, first + period, args=(first,), xtol=1e-15, rtol=1e-14)
        assert np.sin(frequency * landing) < 1 / STRONG  # there, the plate presses
        times += [first, landing]
        first += period
    return np.array([t for t in times if t < END])


BALL = {"mass": 1.0, "inertia": (0.4, 0.4, 0.4), "gravity": G}
LAW = {"contact": Contact(friction=0.3, restitution=0.0, capacity=512)}
ON_PLATES = [
    pytest.param(
        lambda plate: Ball(ground=Ground(motion=plate), **BALL), 0.0, id="at rest", marks=pytest.mark.thorough
    ),
    pytest.param(
        lambda plate: Ball(ground=Ground(motion=plate), **BALL), 1.0, id="rolling", marks=pytest.mark.thorough
    ),
    pytest.param(
        lambda plate: Ball(ground=TiltingPlane(displacement=plate), **BALL), 0.0, id="tilting", marks=pytest.mark.long
    ),
]


@pytest.mark.parametrize(("on", "rate"), ON_PLATES)
def test_a_ball_on_a_shaken_plate_lifts_off_and_lands(on, rate):
    for frequency in FREQUENCIES:
        wanted = lifts_and_landings(frequency)
        start = BallState(Omega=(0.0, rate, 0.0))
        assert counts(on(shaken(frequency)), start, **LAW) == [len(wanted)] * len(TOLERANCES), frequency
        run = jaxball.simulate(on(shaken(frequency)), (0.0, END), start, **LAW)
        times = np.asarray(run.switches.times[: len(wanted)])
        # Lift-offs are zeros of a function of the time alone; a landing that is close to grazing adds its slope.
        np.testing.assert_allclose(times[::2], wanted[::2], atol=1e-10)
        np.testing.assert_allclose(times[1::2], wanted[1::2], atol=1e-8)


@pytest.mark.thorough
def test_a_saved_state_presses_on_the_ground_while_it_rolls():
    """At rest on the plate, N = m (g − a ω² sin ωt)."""
    frequency = 20.0
    for tol in TOLERANCES:
        ball = Ball(ground=Ground(motion=shaken(frequency)), **BALL)
        run = jaxball.simulate(ball, FINE, BallState(), rtol=tol, atol=tol, throw=True, **LAW)
        rolls = np.asarray(run.contact.mode) == Mode.ROLLING
        normal = G * (1 - STRONG * np.sin(frequency * FINE))
        assert rolls.any()
        assert (~rolls).any()
        assert np.min(normal[rolls]) > -1e-9 * G


# Dry friction that holds, and gives way to a force that grows: A sin ωt against at most S, and K once it moves.


def breaks_and_stops(frequency, force, static, kinetic):
    """When something at rest breaks loose, and stops again: ẍ = A sin ωt − K sign ẋ, until ẋ = 0."""
    times, t, period = [], np.arcsin(static / force) / frequency, 2 * np.pi / frequency
    while t < END:
        sign = np.sign(np.sin(frequency * t))

        def speed(later, since=t, sign=sign):
            wave = force * (np.cos(frequency * since) - np.cos(frequency * later)) / frequency
            return sign * wave - kinetic * (later - since)

        # It moves on while the force is larger than K, past the middle of the half period.
        latest = (np.floor(frequency * t / np.pi) + 0.5) * np.pi / frequency
        stop = brentq(speed, latest, t + period, xtol=1e-15, rtol=1e-14)
        assert abs(np.sin(frequency * stop)) * force < static  # there, it is held
        times += [t, stop]
        # The next time the force is as large as S, after the stop.
        phase = np.arcsin(static / force)
        n = np.arange(2 * int(frequency * END / np.pi) + 8)
        edges = np.sort(np.concatenate([(n * np.pi + phase), (n * np.pi - phase)])) / frequency
        grows = np.cos(frequency * edges) * np.sin(frequency * edges) > 0
        t = np.min(edges[grows & (edges > stop)])
    return np.array([t for t in times if t < END])


def assert_counted(system_of, state, wanted_of, frequencies=FREQUENCIES):
    for frequency in frequencies:
        wanted = wanted_of(frequency)
        assert counts(system_of(frequency), state) == [len(wanted)] * len(TOLERANCES), frequency
        run = jaxball.simulate(system_of(frequency), (0.0, END), state)
        kept = min(len(wanted), run.switches.times.size)
        np.testing.assert_allclose(run.switches.times[:kept], wanted[:kept], atol=1e-8)


@pytest.mark.thorough
def test_a_wheel_at_rest_breaks_loose_and_stops():
    """A disk whose rolling resistance is cN r: a force at its centre moves the mass 3m/2 against cN."""
    c = 0.05

    def wheel(frequency):
        force = HarmonicForce((0.0, 0.0, 0.0), amplitude=[(BEYOND * c * G, 0.0, 0.0)], frequency=[frequency])
        return Disk(mass=1.0, inertia=0.5, gravity=G, resistance=Resistance(dry=c, exact=True), force=force)

    def wanted(frequency):
        return breaks_and_stops(frequency, BEYOND * c * G / 1.5, c * G / 1.5, c * G / 1.5)

    assert_counted(wheel, DiskState(), wanted)


def shake(t, theta, thetadot, state, wave):
    return wave[0] * jnp.sin(wave[1] * t)


@pytest.mark.thorough
@pytest.mark.parametrize("kinetic", [0.45, 0.4])
def test_a_joint_that_sticks_breaks_loose_and_stops(kinetic):
    """A block in a tube above the contact point, which the disk does not feel."""
    mass, static = 0.5, 0.45

    def block(frequency):
        drive = jaxball.physics.FunctionJointForce(shake, jnp.array([BEYOND * static, frequency]))
        tube = jaxball.physics.mass_in_tube(mass, (0.0, 0.0, 1.0), drive=drive + JointFriction(kinetic, static))
        return Disk(mass=1.0, inertia=0.5, gravity=0.0, mechanisms=[tube])

    def wanted(frequency):
        return breaks_and_stops(frequency, BEYOND * static / mass, static / mass, kinetic / mass)

    # At 1 rad/s the block would leave the disk.
    assert_counted(block, DiskState(theta=[0.0], thetadot=[0.0]), wanted, FREQUENCIES[1:])
