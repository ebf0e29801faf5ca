"""Exact dry rolling and spinning resistance, against closed forms.

A solid ball on a slope, at the angle φ from downhill, obeys ṡ = G cos φ − K, s φ̇ = −G sin φ with G = (5/7) g sin α and
K = (5/7) c g cos α, so that s (K + G cos φ) falls at the rate K² − G² until it rests; from rest it rolls where G > K.
Where a bound has no reason of its own, 1e-9 is ten times the tolerance, as errors of a few steps add up.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxball
from jaxball import Ball, BallState, Disk, DiskState, Ground, Resistance
from jaxball.analysis.stability import steady_motion
from jaxball.analysis.verify import check_laws
from jaxball.numerics import versor
from jaxball.physics.classical import RollingEllipsoid
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.differences import jacobian
from tests.support.sentences import refuses, said

G, M, R, C, SPINNING = 9.81, 2.0, 0.3, 0.2, 0.01
SOLID = 0.4 * M * R**2
ALPHA, SPEED, PHI, SPIN = 0.1, 1.5, 2.0, 1.0
TIMES = np.linspace(0.0, 4.0, 9)
NOW = jnp.array(0.0)


def disk(c=C, angle=0.0, **others):
    """A disk with the inertia of a solid ball."""
    resistance = Resistance(dry=c, exact=True)
    ground = Ground(angle=angle)
    return Disk(mass=M, inertia=SOLID, radius=R, gravity=G, ground=ground, resistance=resistance, **others)


def ball(c=C, angle=ALPHA, **others):
    resistance = Resistance(dry=c, exact=True, dry_spinning=SPINNING)
    return Ball(
        **{"mass": M, "inertia": (SOLID,) * 3, "radius": R, "gravity": G, "ground": Ground(angle=angle)}
        | {"resistance": resistance, **others}
    )


def towards(speed, phi, spin=SPIN):
    """A ball that rolls at an angle from downhill."""
    return BallState(Omega=jnp.stack([-speed * jnp.sin(phi) / R, speed * jnp.cos(phi) / R, spin + 0.0 * speed]))


def rest(c, v, angle, phi):
    """When and how far from its start such a ball comes to rest, the latter downhill by the energy and the path."""
    pull, drag = 5 / 7 * G * jnp.sin(angle), 5 / 7 * c * G * jnp.cos(angle)
    return v * (drag + pull * jnp.cos(phi)) / (drag**2 - pull**2)


def end_of_spin(angle):
    return SOLID * SPIN / (SPINNING * M * G * jnp.cos(angle) * R)


def stop(c, v):
    run = jaxball.simulate(disk(c), (0.0, 4.0), DiskState(phidot=-v / R))
    return jnp.stack([run.switches.times[0], run.state.z[-1]])


@pytest.mark.thorough
def test_accelerations_follow_from_a_state_alone():
    """As observables need them, without a solve that knows the modes: held, rolling down, and with ω_h of rounding."""
    c = jnp.tan(ALPHA) * jnp.array([1.01, 0.99, 0.5])
    balls = jax.vmap(lambda c: ball(c, ground=Ground(angle=ALPHA, heading=0.7)))(c)
    at_rest = BallState(q=versor.exponential(0.4 * jnp.array([0.6, 0.0, 0.8])))
    rates = jax.jit(jax.vmap(lambda ball, state: jaxball.physics.vector_field(ball, NOW, state), in_axes=(0, None)))
    a = 5 / 7 * G * (np.sin(ALPHA) - np.asarray(c) * np.cos(ALPHA))
    turns = np.where(a > 0, a, 0.0)[:, None] * np.array([-np.sin(0.7), np.cos(0.7), 0.0]) / R
    in_space = jnp.einsum("ij,kj->ki", at_rest.Lambda, rates(balls, at_rest).Omega)
    np.testing.assert_allclose(in_space, turns, atol=1e-14)
    spins = at_rest.with_Omega(at_rest.Lambda.T @ jnp.array([0.0, 0.0, 3.0]))
    slows = turns - np.array([0.0, 0.0, SPINNING * M * G * np.cos(ALPHA) * R / SOLID])
    in_space = jnp.einsum("ij,kj->ki", at_rest.Lambda, rates(balls, spins).Omega)
    np.testing.assert_allclose(in_space, slows, atol=1e-13)


@pytest.mark.thorough
def test_in_motion_it_is_the_smoothed_law_without_smoothing():
    """In a body with a mass before and above its centre, so that friction changes N."""
    state = BallState(Omega=(0.5, -1.0, 0.7))

    def rate(**resistance):
        masses = [jaxball.PointMass(MASS, jaxball.Fixed((0.1, 0.05, 0.15)))]
        law = Resistance(rolling=0.01, dry=C, dry_spinning=SPINNING, **resistance)
        return jaxball.physics.vector_field(ball(masses=masses, resistance=law), NOW, state).Omega

    exact, smoothed = jax.jit(lambda: (rate(exact=True), rate(smoothing=1e-9)))()
    np.testing.assert_allclose(exact, smoothed, rtol=1e-12)


@pytest.mark.long
def test_a_disk_on_level_ground_stops_after_a_finite_time_and_stays():
    run = jaxball.simulate(disk(), TIMES, DiskState(phidot=-SPEED / R), throw=True)
    time, way = 7 * SPEED / (5 * C * G), 7 * SPEED**2 / (10 * C * G)
    np.testing.assert_allclose(run.switches.times[0], time, rtol=1e-12)
    assert int(run.switches.count) == 1
    np.testing.assert_allclose(run.state.z[-1], way, rtol=1e-12)
    moving = time > TIMES
    np.testing.assert_array_equal(run.history.rests, ~moving)
    np.testing.assert_array_equal(run.state.phidot[~moving], 0.0)
    np.testing.assert_array_equal(run.state.z[~moving], run.state.z[-1])
    speed = SPEED - 5 / 7 * C * G * TIMES[moving]
    np.testing.assert_allclose(run.observables.dissipation[moving], C * M * G * speed, rtol=1e-9)
    np.testing.assert_array_equal(run.observables.dissipation[~moving], 0.0)
    assert run.history.lines[1] == f"  t = {time:.10g}: the body comes to rest"


@pytest.mark.slow
def test_derivatives_of_where_and_when_a_disk_stops():
    expected = [
        [-7 * SPEED / (5 * C**2 * G), 7 / (5 * C * G)],
        [-7 * SPEED**2 / (10 * C**2 * G), 7 * SPEED / (5 * C * G)],
    ]
    reverse = jaxball.jit(jax.jacrev(lambda x: stop(*x)))(jnp.array([C, SPEED]))
    np.testing.assert_allclose(reverse, expected, rtol=1e-8)
    forward = jaxball.jit(jax.jacfwd(lambda x: stop(*x)))(jnp.array([C, SPEED]))
    np.testing.assert_allclose(forward, expected, rtol=1e-8)


@pytest.mark.long
def test_a_disk_rests_on_a_slope_up_to_the_angle_of_its_resistance():
    """Thrown uphill it turns back where that is steeper; in rows of one program."""
    c = jnp.tan(ALPHA) * jnp.array([1.01, 1.0 + 1e-9, 0.99, 0.5])
    disks = jax.vmap(lambda c: disk(c, ALPHA))(c)
    run = simulate_ensemble(disks, TIMES, DiskState(), in_axes=(0, None))
    a = 5 / 7 * G * (np.sin(ALPHA) - np.asarray(c) * np.cos(ALPHA))
    np.testing.assert_array_equal(run.state.z[:2], 0.0)
    np.testing.assert_allclose(run.state.z[2:], a[2:, None] * TIMES**2 / 2, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(run.trajectory.history.rests[:, 1:], [[True] * 8] * 2 + [[False] * 8] * 2)
    up = simulate_ensemble(disks, TIMES, DiskState(phidot=SPEED / R), in_axes=(0, None))
    braking = 5 / 7 * G * (np.sin(ALPHA) + np.asarray(c) * np.cos(ALPHA))
    np.testing.assert_allclose(up.trajectory.switches.times[:, 0], SPEED / braking, rtol=1e-10)
    top, left = -(SPEED**2) / (2 * braking), 4.0 - SPEED / braking
    np.testing.assert_allclose(up.state.z[:, -1], top + np.where(a > 0, a, 0.0) * left**2 / 2, rtol=1e-9)
    assert [up[row].switches.lines[0].split(": ")[1] for row in range(4)] == [
        *["the body comes to rest"] * 2,
        *["the body rolls back"] * 2,
    ]


@pytest.mark.long
@pytest.mark.parametrize("phi", [0.5, PHI, 3.0])
def test_a_ball_that_rolls_across_a_slope_turns_downhill_and_comes_to_rest(phi):
    run = jaxball.simulate(ball(), TIMES, towards(SPEED, phi), throw=True)
    stopped, spun = rest(C, SPEED, ALPHA, phi), end_of_spin(ALPHA)
    np.testing.assert_allclose(np.sort(run.switches.times[:2]), np.sort([stopped, spun]), rtol=1e-10)
    assert int(run.switches.count) == 2
    np.testing.assert_array_equal(run.state.Omega[-1], 0.0)
    # A reference of its own, in the time of the direction, in which nothing is singular.
    pull, drag = 5 / 7 * G * np.sin(ALPHA), 5 / 7 * C * G * np.cos(ALPHA)

    def rate(_, x):
        speed = np.exp(x[1])
        return [-pull * np.sin(x[0]), pull * np.cos(x[0]) - drag, *(speed**2 * np.array([np.cos(x[0]), np.sin(x[0])]))]

    path = solve_ivp(rate, (0.0, 60.0), [phi, np.log(SPEED), 0.0, 0.0], rtol=1e-12, atol=1e-14).y[2:, -1]
    np.testing.assert_allclose(run.state.z[-1], path, atol=1e-9)
    # What friction takes from the energy until then is ∫ c N |v| dt, by the same reference.
    seen = run.observables
    energy = seen.kinetic_energy + seen.potential_energy
    lost = M * G * np.sin(ALPHA) * path[0] + 0.7 * M * SPEED**2 + SOLID * SPIN**2 / 2
    np.testing.assert_allclose(energy[0] - energy[-1], lost, rtol=1e-9)
    np.testing.assert_allclose(seen.normal_force[-1], M * G * np.cos(ALPHA), rtol=1e-12)
    np.testing.assert_allclose(seen.friction[-1], [-M * G * np.sin(ALPHA), 0.0], atol=1e-12)
    np.testing.assert_allclose(seen.dissipation[-1], 0.0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("mode", [jax.jacrev, jax.jacfwd])
def test_derivatives_of_when_a_ball_comes_to_rest(mode):
    def times(x):
        c, v, angle, phi = x
        return jaxball.simulate(ball(c, angle), (0.0, 4.0), towards(v, phi)).switches.times[:2]

    def expected(x):
        return jnp.stack([rest(*x), end_of_spin(x[2])])

    x = jnp.array([C, SPEED, ALPHA, PHI])
    np.testing.assert_allclose(jaxball.jit(mode(times))(x), jax.jacrev(expected)(x), atol=1e-8)


@pytest.mark.long
def test_a_ball_begins_to_roll_down_a_slope_that_is_too_steep():
    steep = ball(0.05, ground=Ground(angle=ALPHA, heading=0.7))
    run = jaxball.simulate(steep, TIMES, BallState(Omega=(0.0, 0.0, SPIN)), throw=True)
    a = 5 / 7 * G * (np.sin(ALPHA) - 0.05 * np.cos(ALPHA))
    downhill = np.array([np.cos(0.7), np.sin(0.7)])
    np.testing.assert_allclose(run.state.z, a * TIMES[:, None] ** 2 / 2 * downhill, atol=1e-9)
    np.testing.assert_allclose(run.switches.times[0], end_of_spin(ALPHA), rtol=1e-12)
    up = jaxball.simulate(ball(0.05), TIMES, towards(SPEED, np.pi, 0.0), throw=True)
    braking = 5 / 7 * G * (np.sin(ALPHA) + 0.05 * np.cos(ALPHA))
    place = -(SPEED**2) / (2 * braking) + a * (4.0 - SPEED / braking) ** 2 / 2
    np.testing.assert_allclose(up.state.z[-1], [place, 0.0], atol=1e-9)


SHAKE, DRIFT, MASS, PERIOD = 0.02, 0.05, 0.8, 3.0


def carried(t, parameters):
    """The place of a mass that drifts forward as it bounces up and down."""
    return jnp.stack([DRIFT * t, 0.0 * t, parameters * jnp.sin(PERIOD * t) - 0.1])


def loose(c):
    """When the torque of such a mass about the contact reaches c N r: its weight and inertia, with its own N."""

    def spare(t):
        x, up = DRIFT * t, -SHAKE * PERIOD**2 * np.sin(PERIOD * t)
        N = (M + MASS) * G + MASS * up
        return MASS * x * (G + up) - c * N * R

    times = np.linspace(0.0, 40.0, 40001)
    first = np.flatnonzero(spare(times) > 0)[0]
    return brentq(spare, times[first - 1], times[first], xtol=1e-14)


@pytest.mark.long
def test_a_moving_mass_breaks_a_ball_loose_when_its_torque_exceeds_friction():
    resting = ball(0.02, 0.0, masses=[jaxball.PointMass(MASS, jaxball.Free(carried, SHAKE))])
    run = jaxball.simulate(resting, np.linspace(0.0, 3.0, 4), throw=True)
    np.testing.assert_allclose(run.switches.times[0], loose(0.02), rtol=1e-10)
    assert run.switches.lines[0].endswith("the body rolls")


@pytest.mark.long
def test_a_motor_breaks_a_disk_loose_when_the_torque_about_the_contact_exceeds_friction():
    """The pendulum swings in a disk at rest until then: the moment of its momentum about the contact needs the rest."""
    bob, l, ramp, c = 0.7, 0.2, 0.1, 0.03
    drive = jaxball.Motor(jaxball.ConstantRate(0.0, ramp))
    pendulum = jaxball.planar_pendulum(bob, l, drive=drive)
    run = jaxball.simulate(
        disk(c, mechanisms=[pendulum]), np.linspace(0.0, 8.0, 3), DiskState(theta=[0.0], thetadot=[0.0]), throw=True
    )

    def swing(t, x):
        return [x[1], (ramp * t - bob * G * l * np.sin(x[0])) / (bob * l**2)]

    def spare(t, x):
        angle, rate = x
        turn = swing(t, x)[1]
        inward = l * rate**2
        forward = l * turn * np.cos(angle) - inward * np.sin(angle)
        upward = l * turn * np.sin(angle) + inward * np.cos(angle)
        N = (M + bob) * G + bob * upward
        height = R - l * np.cos(angle)
        torque = bob * (height * forward - l * np.sin(angle) * (upward + G))
        return c * N * R - abs(torque)

    spare.terminal = True
    expected = solve_ivp(swing, (0.0, 8.0), [0.0, 0.0], events=spare, rtol=1e-12, atol=1e-14).t_events[0][0]
    np.testing.assert_allclose(run.switches.times[0], expected, rtol=1e-9)


def robot(c=0.1, spinning=0.03, **others):
    """A ball without symmetry, in which a mass swings: it rests, breaks loose and rests again, each in a direction."""
    frame = jaxball.SphericalFrame(0.4, 0.3)
    swing = jaxball.Sinusoids(-1.6, amplitude=[0.6], frequency=[1.5])
    masses = [jaxball.PointMass(0.4, jaxball.OnRail(jaxball.Circle(0.2, (0.02, -0.03, 0.05), frame), swing))]
    law = Resistance(dry=c, dry_spinning=spinning, **{"exact": True, **others})
    moments = (0.9 * SOLID, 1.1 * SOLID, 1.3 * SOLID)
    return ball(0.0, 0.02, inertia=moments, offset=(0.01, 0.0, -0.02), masses=masses, resistance=law)


PUSHED = jnp.array([0.75, 3.0, 0.7])
SPAN = (0.0, 5.0)


@pytest.mark.slow
def test_the_smoothed_law_tends_to_the_exact_one():
    """Its distance is proportional to its width at first; a little more remains once it has crept loose."""
    times = (0.0, 1.3, 5.0)  # at rest in between, and again at the end
    run = jaxball.simulate(robot(), times, BallState(Omega=PUSHED), throw=True)
    assert [line.split(": ")[1] for line in run.switches.lines] == [
        "its spinning ends",
        "the body comes to rest",
        "the body rolls",
        "the body comes to rest",
    ]
    errors = []
    for smoothing in (4e-4, 2e-4, 1e-4):
        smoothed = robot(exact=False, smoothing=smoothing)
        solver = jaxball.simulation.solvers.RadauIIA(3)
        ends = jaxball.simulate(smoothed, times, BallState(Omega=PUSHED), solver=solver, throw=True).state.z[1:]
        errors.append(np.linalg.norm(ends - run.state.z[1:], axis=1))
    np.testing.assert_allclose(np.divide(errors[1:], errors[:-1])[:, 0], 0.5, atol=0.05)
    assert np.all(np.divide(errors[1:], errors[:-1])[:, 1] < 0.6)
    assert np.all(errors[-1] < 2e-4)


@pytest.mark.slow
def test_derivatives_of_a_robot_that_rests_and_breaks_loose():
    """Against differences over four points, whose errors are some 1e-7 of the derivative."""

    def end(x, tolerance=1e-10):
        start = BallState(Omega=x[2:])
        run = jaxball.simulate(robot(x[0], x[1]), SPAN, start, rtol=tolerance, atol=tolerance)
        return jnp.concatenate([run.state.z[-1], run.switches.times[:4]])

    x = jnp.array([0.1, 0.03, *PUSHED])
    expected = jacobian(jaxball.jit(lambda x: end(x, 1e-13)), x, 1e-5)
    np.testing.assert_allclose(jaxball.jit(jax.jacrev(end))(x), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("solver", [diffrax.Tsit5(), diffrax.Kvaerno5(), jaxball.simulation.solvers.RadauIIA(3)])
def test_other_solvers(solver):
    run = jaxball.simulate(ball(), (0.0, 4.0), towards(SPEED, PHI), solver=solver, throw=True)
    np.testing.assert_allclose(run.switches.times[0], rest(C, SPEED, ALPHA, PHI), rtol=1e-8)


@pytest.mark.slow
def test_a_run_with_rest_obeys_the_laws_of_mechanics():
    report = check_laws(robot(), np.linspace(*SPAN, 51), BallState(Omega=PUSHED))
    assert report.ok
    assert {row.law for row in report.rows if row.applies} >= {"energy", "momentum", "rolling", "error", "solvers"}


def test_what_exact_resistance_is_not_combined_with(no_type_checks):
    with refuses(TypeError, "system"):
        steady_motion(disk(), DiskState())
    with refuses(TypeError, "dae"):
        jaxball.simulate(ball(), TIMES, BallState(), dae=True)
    with refuses(TypeError, "ReducedState"):
        jaxball.simulate(ball(ground=None), TIMES, jaxball.physics.ReducedState())
    with refuses(ValueError, "exact"):
        Resistance(rolling=0.1, exact=True)
    with refuses(ValueError, "resistance"):
        resistance = Resistance(dry=0.1, exact=True)
        RollingEllipsoid(semiaxes=(1.0, 1.0, 1.5), inertia=(0.65, 0.65, 0.4), resistance=resistance)
    (problem,) = jaxball.problems(disk(0.0))
    said(problem, "resistance.dry")
