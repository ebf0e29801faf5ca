"""Exact dry resistance with a level at rest above that in motion, and with levels that depend on the rate.

A solid body on level ground under the horizontal force X t rests until X t = s M g, and then obeys
1.4 M v̇ = X t − c M g. Where a bound has no reason of its own, 1e-9 is ten times the tolerance, as errors of a few steps
add up.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxball
from jaxball import (
    Ball,
    BallState,
    Contact,
    Disk,
    DiskState,
    FunctionForce,
    FunctionSchedule,
    Ground,
    Resistance,
    Turntable,
    simulate,
)
from jaxball.analysis.verify import check_laws
from jaxball.physics import AbstractResistance
from tests.support.sentences import refuses, said

G, M, R = 9.81, 2.0, 0.3
SOLID = 0.4 * M * R**2
STATIC, KINETIC, RAMP = 0.05, 0.03, 1.0
ALONG = np.array([0.6, 0.8, 0.0])
END = 3.0
NUMBERS = jnp.array([STATIC, KINETIC, RAMP])


def ramp(t, x):
    return x * t * jnp.asarray(ALONG)


def ramp_along_line(t, x):
    return x * t * jnp.array([1.0, 0.0, 0.0])


def disk(resistance, **others):
    """A disk with the inertia of a solid ball."""
    return Disk(mass=M, inertia=SOLID, radius=R, gravity=G, resistance=resistance, **others)


def ball(resistance, **others):
    return Ball(mass=M, inertia=(SOLID,) * 3, radius=R, gravity=G, resistance=resistance, **others)


def pulled(kind, x, contact=None, **others):
    """Such a body from rest until END, under the numbers (s, c, X)."""
    resistance = Resistance(dry=x[1], static_dry=x[0], exact=True, **others)
    if kind is disk:
        body, start = disk(resistance, force=FunctionForce(ramp_along_line, x[2])), DiskState()
    else:
        body, start = ball(resistance, force=FunctionForce(ramp, x[2])), BallState()
    return simulate(body, (0.0, END), start, contact=contact)


def reached(x):
    """When it breaks loose, and its way and speed at the end."""
    s, c, X = x
    t0 = s * M * G / X
    way = X * (END**3 / 6 - t0**2 * END / 2 + t0**3 / 3) - c * M * G * (END - t0) ** 2 / 2
    speed = X * (END**2 - t0**2) / 2 - c * M * G * (END - t0)
    return jnp.stack([t0, way / (1.4 * M), speed / (1.4 * M)])


def along_line(x):
    run = pulled(disk, x)
    return jnp.stack([run.switches.times[0], run.state.z[-1], -R * run.state.phidot[-1]])


def in_plane(x, contact=None):
    run = pulled(ball, x, contact)
    place, speed = run.state.z[-1] @ ALONG[:2], R * jnp.array([-ALONG[1], ALONG[0]]) @ run.state.Omega[-1, :2]
    return jnp.stack([run.switches.times[0], place, jnp.where(speed == 0, 0.0, speed)])


def test_a_disk_breaks_loose_at_the_static_level_and_moves_against_the_kinetic_one():
    run = pulled(disk, NUMBERS)
    found = [run.switches.times[0], run.state.z[-1], -R * run.state.phidot[-1]]
    np.testing.assert_allclose(found, reached(NUMBERS), rtol=1e-9)
    assert int(run.switches.count) == 1
    assert run.switches.lines[0].endswith("the body rolls")


@pytest.mark.long
def test_derivatives_of_the_time_of_release_and_of_the_motion_after_it():
    """The acceleration jumps as the level does, so that all of them depend on when it breaks loose."""
    expected = jax.jacrev(reached)(NUMBERS)
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(along_line))(NUMBERS), expected, rtol=1e-8, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("mode", [jax.jacrev, jax.jacfwd])
@pytest.mark.parametrize("contact", [None, Contact(0.5)], ids=["rolls", "contact"])
def test_the_same_of_a_ball_with_and_without_a_law_of_contact(mode, contact):
    """Friction of 0.5 N holds its contact at all times."""
    run = pulled(ball, NUMBERS, contact)
    speed = R * np.array([-ALONG[1], ALONG[0], 0.0]) @ (run.state.Lambda[-1] @ run.state.Omega[-1])
    found = [run.switches.times[0], run.state.z[-1] @ ALONG[:2], speed]
    np.testing.assert_allclose(found, reached(NUMBERS), rtol=1e-9)
    expected = jax.jacrev(reached)(NUMBERS)[:2]
    derivatives = jaxball.jit(mode(lambda x: in_plane(x, contact)[:2]))(NUMBERS)
    np.testing.assert_allclose(derivatives, expected, rtol=1e-7, atol=1e-8)


def sway(t, x):
    return x * jnp.sin(t) * jnp.array([1.0, 0.0, 0.0])


@pytest.mark.long
def test_a_disk_that_stops_is_held_up_to_the_static_level():
    """Under F sin t it moves from arcsin(s M g / F) on until its speed is 0, and rests till the next half turn."""
    X, kinetic = 1.3 * STATIC * M * G, 0.04
    body = disk(Resistance(dry=kinetic, static_dry=STATIC, exact=True), force=FunctionForce(sway, X))
    times = np.linspace(0.0, 2 * np.pi, 25)
    run = simulate(body, times, DiskState(), dense=True, throw=True)
    released, brake = np.arcsin(STATIC * M * G / X), kinetic * M * G

    def speed(t):
        return (X * (np.cos(released) - np.cos(t)) - brake * (t - released)) / (1.4 * M)

    def way(t):
        span = t - released
        return (X * (np.cos(released) * span - np.sin(t) + np.sin(released)) - brake * span**2 / 2) / (1.4 * M)

    stops = brentq(speed, 2.5, 2 * np.pi, xtol=1e-14)
    assert stops < np.pi + released, "it rests in between"
    np.testing.assert_allclose(run.switches.times[:3], [released, stops, np.pi + released], rtol=1e-9)
    assert [line.split(": ")[1] for line in run.switches.lines] == [
        "the body rolls",
        "the body comes to rest",
        "the body rolls",
    ]
    first, second = (times > released) & (times < stops), times > np.pi + released
    there = np.zeros_like(times)
    there[first], there[times >= stops] = way(times[first]), way(stops)
    there[second] -= way(times[second] - np.pi)
    np.testing.assert_allclose(run.state.z, there, atol=1e-9)
    np.testing.assert_array_equal(run.history.rests, ~(first | second))
    # What friction takes is the kinetic level over the whole way, there and back.
    whole = way(stops) + way(times[-1] - np.pi)
    np.testing.assert_allclose(run.energy_losses().dry[-1], brake * whole, rtol=1e-8)


@pytest.mark.long
def test_a_body_on_a_slope_between_the_levels_stays_at_rest_and_goes_on_rolling():
    slope = np.arctan((STATIC + KINETIC) / 2)
    body = disk(Resistance(dry=KINETIC, static_dry=STATIC, exact=True), ground=Ground(angle=slope))
    times = np.linspace(0.0, 2.0, 5)
    assert np.all(simulate(body, times, DiskState(), throw=True).state.z == 0)
    speed = 0.2
    rolls = simulate(body, times, DiskState(phidot=-speed / R), throw=True)
    a = G * (np.sin(slope) - KINETIC * np.cos(slope)) / 1.4
    np.testing.assert_allclose(rolls.state.z, speed * times + a * times**2 / 2, atol=1e-9)


# Levels that depend on the rate.

FALL, OMEGA = 0.8, 5.0  # of the exponential law, rad/time, and a rate at the start


def stop(x):
    """When and where a disk on level ground stops: I ω̇ = −N r (c + (s − c) exp(−ω/S)), in closed form."""
    c, s, S, omega = x
    k, d = 5 * G / (7 * R), s - c
    return S / (k * c) * jnp.log((c * jnp.exp(omega / S) + d) / (c + d))


@pytest.mark.long
def test_friction_that_falls_with_the_rate_stops_a_disk_in_closed_form():
    x = jnp.array([KINETIC, 3 * KINETIC, FALL, OMEGA])

    def found(x):
        law = Resistance(dry=x[0], static_dry=x[1], stribeck=x[2], exponent=1, exact=True)
        return simulate(disk(law), (0.0, 20.0), DiskState(phidot=-x[3])).switches.times[0]

    time, rates = jaxball.jit(jax.value_and_grad(found))(x)
    np.testing.assert_allclose(time, stop(x), rtol=1e-10)
    np.testing.assert_allclose(rates, jax.grad(stop)(x), rtol=1e-8)


@pytest.mark.slow
def test_a_ball_that_turns_downhill_under_friction_that_falls_with_the_rate():
    """ṡ = A cos φ − B level(s/r) and s φ̇ = −A sin φ, in the time τ with dt = s dτ, in which nothing is singular."""
    slope, speed, phi, spin = 0.1, 1.5, 2.0, 1.0
    law = Resistance(dry=0.12, static_dry=0.2, dry_spinning=0.01, static_dry_spinning=0.02, stribeck=2.0, exact=True)
    start = BallState(Omega=(-speed * np.sin(phi) / R, speed * np.cos(phi) / R, spin))
    run = simulate(ball(law, ground=Ground(angle=slope)), (0.0, 4.0), start, throw=True)
    pull, press = 5 / 7 * G * np.sin(slope), 5 / 7 * G * np.cos(slope)

    def level(rate, kinetic, static):
        return kinetic + (static - kinetic) * np.exp(-((rate / 2.0) ** 2))

    def rate(_, x):
        s = np.exp(x[1])
        slows = pull * np.cos(x[0]) - press * level(s / R, 0.12, 0.2)
        return [-pull * np.sin(x[0]), slows, s**2 * np.cos(x[0]), s**2 * np.sin(x[0]), s]

    end = solve_ivp(rate, (0.0, 60.0), [phi, np.log(speed), 0.0, 0.0, 0.0], rtol=1e-12, atol=1e-14).y[2:, -1]
    np.testing.assert_allclose(run.state.z[-1], end[:2], atol=1e-9)

    def spins(_, x):
        return [-level(x[0], 0.01, 0.02) * M * G * np.cos(slope) * R / SOLID]

    def still(_, x):
        return x[0]

    still.terminal = True
    ends = solve_ivp(spins, (0.0, 10.0), [spin], events=still, rtol=1e-12, atol=1e-14).t_events[0][0]
    np.testing.assert_allclose(np.sort(run.switches.times[:2]), np.sort([end[2], ends]), rtol=1e-9)
    assert int(run.switches.count) == 2
    np.testing.assert_array_equal(run.state.Omega[-1], 0.0)


def speeding(t, x):
    """The angle of a table with the rate W = A t²/(1 + t²)."""
    return x * (t - jnp.arctan(t))


@pytest.mark.long
def test_a_turntable_that_speeds_up_turns_a_ball_until_the_static_level():
    """Over its axis a ball has the rate W until I Ẇ = s N r; then it gains c N r / I until it has W again."""
    A, c, s = 5.0, 0.02, 0.03
    most = M * G * R / SOLID
    law = Resistance(dry=0.05, dry_spinning=c, static_dry_spinning=s, exact=True)
    table = Turntable(FunctionSchedule(speeding, A))
    times = np.array([0.0, 0.2, 1.5, 2.5, 4.0])
    run = simulate(ball(law, ground=Ground(turntable=table)), times, BallState(), throw=True)

    def W(t):
        return A * t**2 / (1 + t**2)

    def gain(t):
        return 2 * A * t / (1 + t**2) ** 2

    loose = brentq(lambda t: gain(t) - s * most, 0.0, 0.5, xtol=1e-15)

    def behind(t):
        return W(loose) + c * most * (t - loose)

    caught = brentq(lambda t: behind(t) - W(t), 2.0, 4.0, xtol=1e-15)
    assert gain(caught) < s * most, "friction holds it then"
    assert int(run.switches.count) == 2
    np.testing.assert_allclose(run.switches.times[:2], [loose, caught], rtol=1e-9)
    rate = np.where((times > loose) & (times < caught), behind(times), W(times))
    np.testing.assert_allclose(run.state.Omega[:, 2], rate, atol=1e-9)


# Own laws.

PUSHED = BallState(Omega=(0.01, 0.05, 0.7))


def swayed(law):
    """A ball that a mass keeps upright and a force pushes to and fro."""
    masses = [jaxball.PointMass(0.4, jaxball.Fixed((0.01, -0.01, -0.1)))]
    return ball(law, masses=masses, force=FunctionForce(sway, 0.8))


class Felt(AbstractResistance):
    """Levels c and a static one, as those of a Resistance, stated by a class of its own."""

    level: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    largest: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    def contact_torque(self, Omega, Gamma):
        return jnp.zeros_like(Omega)

    def rolling_level(self, rate):
        return self.level

    def spinning_level(self, rate):
        return self.level

    @property
    def static_rolling_level(self):
        return self.largest


class Mud(AbstractResistance):
    """A level that grows with the rate, c + b |ω_h|."""

    level: Float[Array, ""] = eqx.field(converter=jnp.asarray)
    slope: Float[Array, ""] = eqx.field(converter=jnp.asarray)

    def contact_torque(self, Omega, Gamma):
        return jnp.zeros_like(Omega)

    def rolling_level(self, rate):
        return self.level + self.slope * rate


@pytest.mark.long
def test_an_own_law_is_that_of_a_resistance_which_states_the_same():
    """A ball without symmetry that is pushed to and fro: it rests, breaks loose and rests again."""

    def run(law):
        return simulate(swayed(law), (0.0, 5.0), PUSHED, throw=True)

    own = run(Felt(0.02, 0.03))
    builtin = run(Resistance(dry=0.02, static_dry=0.03, dry_spinning=0.02, exact=True))
    assert int(own.switches.count) == int(builtin.switches.count) == 5
    np.testing.assert_allclose(own.switches.times, builtin.switches.times, rtol=1e-12)
    np.testing.assert_allclose(own.state.z, builtin.state.z, rtol=0, atol=1e-12)


@pytest.mark.long
def test_an_own_level_that_grows_with_the_rate_stops_a_disk_in_closed_form():
    """I ω̇ = −N r (c + b ω), so that it stops after ln(1 + b ω / c) / (k b)."""
    c, b, k = 0.03, 0.02, 5 * G / (7 * R)
    run = simulate(disk(Mud(c, b)), (0.0, 20.0), DiskState(phidot=-OMEGA), throw=True)
    np.testing.assert_allclose(run.switches.times[0], np.log1p(b * OMEGA / c) / (k * b), rtol=1e-10)
    assert int(run.switches.count) == 1
    assert run.state.phidot[-1] == 0


def test_what_must_hold_of_levels():
    for name, numbers in (
        ("static_dry", {"dry": 0.1, "static_dry": 0.2}),
        ("static_dry_spinning", {"dry": 0.1, "static_dry_spinning": 0.2, "exact": True}),
        ("stribeck", {"dry": 0.1, "stribeck": 1.0, "exact": True}),
        ("exponent", {"dry": 0.1, "exponent": 0}),
    ):
        with refuses(ValueError, name):
            Resistance(**numbers)
    for law, name in (
        (Resistance(dry=0.2, static_dry=0.1, exact=True), "static_dry"),
        (Felt(0.2, 0.1), "static_rolling_level"),
        (Mud(0.0, 0.1), "rolling_level"),
    ):
        (problem,) = jaxball.problems(disk(law))
        said(problem, f"resistance.{name}")
    assert jaxball.problems(disk(Felt(0.2, 0.3))) == []


@pytest.mark.thorough
def test_a_normal_force_exists_with_the_level_at_the_present_rate():
    """Painlevé's paradox: a mass ahead of the contact point, and a level that is too large at slow rates alone."""
    mass, place = 2.0, 0.9
    B = 0.01 + 0.1 + mass * (1 + place**2)
    critical = B / (mass * place)  # of a light shell with radius 1, as in tests/physics/test_painleve.py

    def problems(rate):
        law = Resistance(dry=0.1, static_dry=2 * critical, stribeck=1.0, exponent=1, exact=True)
        masses = [jaxball.PointMass(mass, jaxball.Fixed((place, 0.0, 0.0)))]
        body = Ball(mass=0.1, inertia=(0.01,) * 3, masses=masses, resistance=law)
        return jaxball.problems(body, BallState(Omega=(0.0, rate, 0.0)))

    # 0.1 + (2 critical − 0.1) exp(−rate) is critical at this rate.
    rate = np.log((2 * critical - 0.1) / (critical - 0.1))
    assert problems(1.001 * rate) == []
    assert problems(0.999 * rate)[0].startswith("Argument `resistance.dry` must be so small")


@pytest.mark.slow
def test_runs_with_static_levels_obey_the_laws_of_mechanics():
    law = Resistance(dry=0.02, static_dry=0.03, dry_spinning=0.02, static_dry_spinning=0.04, stribeck=0.5, exact=True)
    report = check_laws(swayed(law), np.linspace(0.0, 5.0, 51), PUSHED)
    assert report.ok
    assert {row.law for row in report.rows if row.applies} >= {"energy", "momentum", "rolling", "error", "solvers"}
