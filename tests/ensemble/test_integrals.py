"""Integrals along a run are as exact as the run: where a body turns back, rests, slips, or is stopped by an event."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jaxball import (
    Ball,
    BallState,
    Belt,
    ConstantRate,
    Contact,
    Disk,
    DiskState,
    Event,
    Fixed,
    Ground,
    PointMass,
    Turntable,
)
from jaxball.physics import ReleasedState
from jaxball.simulation.ensemble import REDUCTIONS, Integral, Maximum, Minimum, simulate_ensemble

G, SLOPE = 9.81, 0.3
DISTANCE = {"distance": REDUCTIONS["distance"]}
TOLERANCES = pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])


def reductions_of(system, times, state, reductions, **settings):
    """What is found of a batch of two equal runs, as one number each."""
    batch = functools.partial(jax.tree.map, lambda x: jnp.broadcast_to(jnp.asarray(x), (2, *jnp.shape(x))))
    if "contact" in settings:
        settings["contact"] = batch(settings["contact"])
    many = simulate_ensemble(batch(system), times, batch(state), reductions=reductions, **settings)
    return {name: value[0] for name, value in many.reductions.items()}


# A disk that rolls up a slope with the speed v, at the acceleration a = g sin α / (1 + d/(m r²)), and back down.

V, END = 1.3, 2.0


def up_and_back(v, slope, tolerance=1e-10):
    disk = Disk(mass=1.0, inertia=0.5, gravity=G, ground=Ground(slope))
    state = DiskState(phidot=v)
    return reductions_of(disk, [0.0, END], state, DISTANCE, rtol=tolerance, atol=tolerance)["distance"]


def distance_up_and_back(v, slope):
    """v²/(2a) up to where it turns at v/a, and a (T − v/a)²/2 from there."""
    a = G * jnp.sin(slope) / 1.5
    return v**2 / (2 * a) + a * (END - v / a) ** 2 / 2


@pytest.mark.thorough
def test_a_disk_that_turns_back_on_a_slope():
    # The motion is a quadratic in time, which every step has to rounding: so must the distance.
    for tolerance in (1e-6, 1e-10):
        np.testing.assert_allclose(up_and_back(V, SLOPE, tolerance), distance_up_and_back(V, SLOPE), rtol=1e-13)


def test_distances_on_a_belt_and_on_a_turntable():
    """With Ω = 0 a belt of speed 2 carries a ball by 2 T; with Ω₂ = −2/r it stays where it is. A uniform ball on a
    turntable goes along a circle, at the speed at which it was set down (S. Earnshaw, Dynamics, 1844).
    """
    uniform = functools.partial(Ball, mass=1.0, inertia=(0.4, 0.4, 0.4), gravity=G)
    on_belt = uniform(ground=Ground(belt=Belt(ConstantRate(0.0, rate=2.0))))
    on_table = uniform(ground=Ground(turntable=Turntable(ConstantRate(0.0, rate=1.5))))
    found = [
        reductions_of(system, [0.0, END], state, DISTANCE)["distance"]
        for system, state in (
            (on_belt, BallState()),
            (on_belt, BallState(Omega=(0.0, -2.0, 0.0))),
            (on_table, BallState(z=(0.8, 0.0))),
        )
    ]
    np.testing.assert_allclose(found, [2.0 * END, 0.0, 1.5 * 0.8 * END], rtol=1e-9, atol=1e-13)


@pytest.mark.thorough
@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_derivatives_of_the_distance_of_a_disk_that_turns_back(derivative):
    """∂s/∂v = 2v/a − T and the like: by each piece on its side of the kink, which itself adds nothing."""
    wanted = jax.grad(distance_up_and_back, (0, 1))(V, SLOPE)
    slopes = derivative(up_and_back, (0, 1))(V, SLOPE)
    # The kink is found to some 1e-10 of a step, where the derivative of the speed jumps.
    np.testing.assert_allclose(slopes, wanted, rtol=1e-9)


# A disk with a mass below its centre that rocks: ½ I(φ) φ̇² − m g l cos φ, with I(φ) = m₀ r² + d + m (r² − 2 r l cos φ +
# l²).

MASSES, BELOW, SPAN = np.array([0.5, 0.8, 1.1, 1.7, 2.0]), 0.5, (0.0, 11.3)


def rocking_distance(m):
    """The path of the centre from rest at φ = 1, |Δφ| from turn to turn, by SciPy."""

    def field(_, y):
        inertia = 1.5 + m * (1 - 2 * BELOW * np.cos(y[0]) + BELOW**2)
        return [y[1], -m * BELOW * np.sin(y[0]) * (y[1] ** 2 + 1) / inertia]

    run = solve_ivp(field, SPAN, [1.0, 0.0], method="DOP853", rtol=1e-13, atol=1e-14, events=lambda _, y: y[1])
    turns = [y[0] for t, y in zip(run.t_events[0], run.y_events[0], strict=True) if t > 1e-6]
    return np.sum(np.abs(np.diff([1.0, *turns, run.y[0, -1]])))


def rock(masses, tolerance):
    disks = jax.vmap(lambda m: Disk(mass=1.0, inertia=0.5, masses=[PointMass(m, Fixed((0.0, 0.0, -BELOW)))]))(masses)
    settings = {"in_axes": (0, None), "reductions": DISTANCE, "rtol": tolerance, "atol": tolerance}
    return simulate_ensemble(disks, SPAN, DiskState(phi=1.0), **settings).reductions["distance"]


@pytest.mark.thorough
@TOLERANCES
def test_a_disk_that_rocks(tolerance):
    wanted = [rocking_distance(m) for m in MASSES]
    # The state at the end is within 0.2 tolerances of SciPy's.
    np.testing.assert_allclose(rock(jnp.asarray(MASSES), tolerance), wanted, rtol=0, atol=2 * tolerance)


@pytest.mark.long
@TOLERANCES
def test_derivatives_of_the_distance_of_a_disk_that_rocks(tolerance):
    h = 1e-4

    def slope(m):  # of fourth order: an error of 1e-12, and of rounding 1e-13 / h
        near, far = ((rocking_distance(m + k * h) - rocking_distance(m - k * h)) / (2 * k * h) for k in (1, 2))
        return (4 * near - far) / 3

    wanted, masses = np.array([slope(m) for m in MASSES]), jnp.asarray(MASSES)
    forward = jax.jvp(lambda m: rock(m, tolerance), (masses,), (jnp.ones(MASSES.size),))[1]
    reverse = jax.grad(lambda m: jnp.sum(rock(m, tolerance)))(masses)
    # Derivatives of the run are within a few tolerances themselves.
    np.testing.assert_allclose(forward, wanted, rtol=0, atol=10 * tolerance)
    np.testing.assert_allclose(reverse, wanted, rtol=0, atol=10 * tolerance)


# A ball that slides with the speed v, and rolls from some time on.

LATER = 6.0


def slide_and_roll(v, mu, tolerance=1e-10):
    ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), gravity=G)
    state = ReleasedState(BallState(), V=jnp.asarray(v) * jnp.array([1.0, 0.0, 0.0]))
    settings = {"contact": Contact(friction=mu), "rtol": tolerance, "atol": tolerance}
    return reductions_of(ball, [0.0, LATER], state, DISTANCE, **settings)["distance"]


def distance_of_sliding(v, mu):
    """5vT/7 + 2v²/(49 μ g)."""
    return 5 * v * LATER / 7 + 2 * v**2 / (49 * mu * G)


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-10])
def test_the_distance_of_a_ball_that_slides_and_then_rolls(tolerance):
    """The end of the slip, which a solve passes in one go, is a part of the path."""
    # Both motions are polynomials in time, so that nothing but the time at which the slip ends has an error.
    distance = slide_and_roll(2.0, 0.1, tolerance)
    np.testing.assert_allclose(distance, distance_of_sliding(2.0, 0.1), rtol=0, atol=1e-3 * tolerance)


@pytest.mark.long
@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_derivatives_of_the_distance_of_a_ball_that_slides(derivative):
    wanted = jax.grad(distance_of_sliding, (0, 1))(2.0, 0.1)
    np.testing.assert_allclose(derivative(slide_and_roll, (0, 1))(2.0, 0.1), wanted, rtol=1e-8)


def ripple(system, t, state):
    """sin² 200 t, which has 318 maxima in 5 s."""
    return jnp.sin(200 * t) ** 2


def corners(system, t, state):
    """|sin 200 t|."""
    return jnp.abs(jnp.sin(200 * t))


def burst(system, t, state):
    """sin 20 t in a bell, whose largest value is that of no other swing."""
    return jnp.sin(20 * t) * jnp.exp(-(((t - 3.3) / 0.5) ** 2))


def beyond(system, t, state):
    """1 beyond z = 1, where it jumps."""
    return jnp.where(jnp.abs(state.z) > 1, 1.0, 0.0)


def nothing(system, t, state):
    """0."""
    return 0.0 * t


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance", [1e-6, 1e-10])
def test_quantities_that_swing_while_the_state_rests(tolerance):
    """A step is then as long as the run."""
    end, turns = 5.0, int(200 * 5.0 / np.pi)
    found = {"wave": Integral(ripple), "path": Integral(corners), "none": Integral(nothing)}
    found |= {"most": Maximum(burst), "least": Minimum(burst), "highest": Maximum(ripple)}
    disk = Disk(mass=1.0, inertia=0.5)
    values = reductions_of(disk, [0.0, end], DiskState(), found, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(values["wave"], end / 2 - np.sin(400 * end) / 800, rtol=tolerance)
    np.testing.assert_allclose(
        values["path"], (2 * turns + 1 - np.cos(200 * end - turns * np.pi)) / 200, rtol=tolerance
    )
    assert values["none"] == 0
    times = np.linspace(0, end, 200_001)
    swings = np.asarray(burst(disk, times, None))
    # Samples 25 µs apart miss an extreme of curvature 400 by 400 (12.5 µs)² / 2.
    for name, wanted in (("most", swings.max()), ("least", swings.min())):
        np.testing.assert_allclose(values[name], wanted, rtol=0, atol=1e-7)
    np.testing.assert_allclose(values["highest"], 1, rtol=0, atol=1e-9)


def swell(system, t, state):
    """sin ωt in a wide bell, of which the neighbours of the largest swing are lower by as little as a millionth."""
    return jnp.sin(system.gravity * t) * jnp.exp(-(((t - system.inertia) / system.mass) ** 2))


@pytest.mark.thorough
def test_the_largest_of_many_swings_that_are_almost_equal():
    """By values within some 1e-3 of the largest in each piece, a neighbour was found in a third of these cases."""
    rng = np.random.default_rng(0)
    width, middle, omega = rng.uniform(1, 8, 60), rng.uniform(0.5, 4.5, 60), rng.uniform(150, 250, 60)
    disks = jax.vmap(lambda mass, inertia, gravity: Disk(mass=mass, inertia=inertia, gravity=gravity))(
        jnp.array(width), jnp.array(middle), jnp.array(omega)
    )
    found = simulate_ensemble(disks, [0.0, 5.0], reductions={"most": Maximum(swell)}).reductions
    # Every swing by Newton's method for ω cos ωt = 2 (t − c)/w² sin ωt, from where the sine is 1, and the end.
    turns = (np.arange(400) + 0.25)[:, None] * 2 * np.pi / omega
    t = np.where(turns < 5, turns, 5.0)
    for _ in range(4):
        bend = 2 * (t - middle) / width**2
        slope = omega * np.cos(omega * t) - bend * np.sin(omega * t)
        t = t + slope / ((omega**2 + 2 / width**2) * np.sin(omega * t) + bend * omega * np.cos(omega * t))
    t = np.concatenate([t, np.full((1, 60), 5.0)])
    swings = np.where(t <= 5, np.sin(omega * t) * np.exp(-(((t - middle) / width) ** 2)), -1.0)
    np.testing.assert_allclose(found["most"], swings.max(axis=0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["most_time"], t[swings.argmax(axis=0), np.arange(60)], rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_a_quantity_that_jumps():
    """The disk passes z = 1 after a second."""
    disk, state = Disk(mass=1.0, inertia=0.5), DiskState(phidot=-1.0)
    found = reductions_of(disk, [0.0, 5.0], state, {"time": Integral(beyond)})
    np.testing.assert_allclose(found["time"], 4, rtol=1e-10)


def place(system, t, state):
    """How far down the slope."""
    return jnp.abs(state.z)


def turning(system, t, state):
    """φ̇, which grows all the time."""
    return jnp.abs(state.phidot)


def duration(system, t, state):
    """1, whose integral is the length of the run."""
    return 1.0 + 0.0 * t


@pytest.mark.long
def test_a_run_that_an_event_ends_counts_up_to_the_event():
    """2 = a T²/2 down a slope: distance 2, largest speed √(4a), and T = √(4/a)."""
    found = DISTANCE | {"most": Maximum(place), "fastest": Maximum(turning), "time": Integral(duration)}

    def stopped(slope):
        disk = Disk(mass=1.0, inertia=0.5, gravity=G, ground=Ground(slope))
        events = {"post": Event(lambda system, t, state: jnp.abs(state.z) - 2.0, terminal=True)}
        values = reductions_of(disk, [0.0, 5.0], DiskState(), found, events=events)
        return jnp.stack([values[name] for name in ("distance", "most", "fastest", "time")])

    def wanted(slope):
        a = G * jnp.sin(slope) / 1.5
        return jnp.stack([2.0 + 0 * a, 2.0 + 0 * a, jnp.sqrt(4 * a), jnp.sqrt(4 / a)])

    # The largest values are found to the square root of rounding near the end of the run.
    np.testing.assert_allclose(stopped(SLOPE), wanted(SLOPE), rtol=1e-9)
    for derivative in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(derivative(stopped)(SLOPE), jax.jacfwd(wanted)(SLOPE), rtol=1e-8, atol=1e-9)
