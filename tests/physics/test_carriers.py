"""Turntables and belts on grounds of any form: closed forms, grounds that turn as a whole, and Galileo's principle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    Ball,
    BallState,
    Belt,
    Bowl,
    ConstantRate,
    Contact,
    Disk,
    DiskState,
    Ground,
    HeightField,
    PiecewiseAcceleration,
    Pulse,
    Resistance,
    Turntable,
    simulate,
)
from jaxball.physics import Cylinder, LimitSurface, MovingFrame, ReleasedState, TiltingPlane, Turn
from jaxball.physics.dynamics.footing import footing
from tests.support.differences import jacobian
from tests.support.sentences import refuses, said

G, D = 9.81, 0.4
K = D  # the moment of inertia over m r², of a solid ball
TIGHT = {"rtol": 1e-11, "atol": 1e-12}
TIMES = np.linspace(0.0, 3.0, 7)


def solid(**parts):
    return Ball(**{"mass": 1.0, "inertia": (D, D, D), "gravity": G} | parts)


def loaded(**parts):
    """An unbalanced ball with a pendulum, a mass on a rail and friction against the spin."""
    return Ball(
        mass=1.0,
        inertia=(0.4, 0.45, 0.5),
        offset=(0.02, -0.03, -0.1),
        gravity=G,
        masses=[jaxball.PointMass(0.2, jaxball.OnRail(jaxball.Circle(0.5), ConstantRate(0.0, rate=1.0)))],
        mechanisms=[jaxball.planar_pendulum(0.3, 0.4)],
        **{"resistance": Resistance(rolling=0.05, spinning=0.02)} | parts,
    )


def waves(t, x, y, size):
    return size * jnp.sin(0.8 * x) * jnp.cos(0.6 * y)


@pytest.mark.parametrize(
    "plane", [lambda **k: Ground(0.1, **k), lambda **k: TiltingPlane(about_e2=ConstantRate(0.1), **k)]
)
def test_a_ball_on_a_belt_that_speeds_up(plane):
    """ż̇ = g sin a/(1 + k) e1 + k/(1 + k) u̇ on an incline, for any motion of the belt."""
    belt = Belt(Pulse(0.0, height=2.0, rate=1.0), heading=0.7)
    run = simulate(solid(ground=plane(belt=belt)), TIMES, BallState(), **TIGHT)
    travelled, speed, _ = jax.vmap(belt.travel.derivatives)(jnp.asarray(TIMES))
    ahead = np.array([np.cos(0.7), np.sin(0.7)])
    # The ball is set down with Ω = 0 on a belt that moves already, and so has its velocity.
    carried = np.asarray(travelled - travelled[0])[:, None] * K / (1 + K) + np.asarray(TIMES * speed[0])[:, None] / (
        1 + K
    )
    falls = 0.5 * TIMES**2 * G * np.sin(0.1) / (1 + K)
    expected = carried * ahead + falls[:, None] * np.array([1.0, 0.0])
    np.testing.assert_allclose(run.state.z, expected, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("carrier", ["turntable", "belt"])
def test_two_planes_carry_alike(carrier):
    """A plane in axes of its own, and one that is a surface in space, with all that a ball may have."""
    carriers = {
        "turntable": Turntable(Pulse(0.3, height=2.0, rate=0.5), (0.5, -0.2)),
        "belt": Belt(Pulse(0.3, height=2.0, rate=0.5), heading=0.4),
    }
    start = BallState(z=(0.3, -0.2), Omega=(0.4, -0.8, 0.3), theta=(0.2,), thetadot=(0.1,))
    one, other = (
        simulate(loaded(ground=plane(**{carrier: carriers[carrier]})), TIMES[:5], start, **TIGHT)
        for plane in (Ground, TiltingPlane)
    )
    for name in (
        "angular_velocity_body",
        "kinetic_energy",
        "power",
        "contact_momentum",
        "contact_force",
        "dissipation",
    ):
        got, wanted = getattr(other.observables, name), getattr(one.observables, name)
        np.testing.assert_allclose(got, wanted, atol=1e-8, err_msg=name)


def frame(schedule, axis=(0.0, 0.0, 1.0)):
    return MovingFrame([Turn(axis, schedule)])


# Grounds of revolution: what turns in them, and what turns them as a whole, are the same.
TURNING = {
    "a bowl": lambda turns, whole: Bowl(
        3.0, **({"motion": frame(turns)} if whole else {"turntable": Turntable(turns)})
    ),
    "a drum": lambda turns, whole: Cylinder(
        3.0,
        axis=(0.0, 1.0, 0.0),
        **(
            {"motion": MovingFrame([Turn((0.0, 1.0, 0.0), turns)])}
            if whole
            else {"belt": Belt(PiecewiseAcceleration(*_scaled(turns, 3.0)), heading=np.pi / 2)}
        ),
    ),
}


def _scaled(turns, by):
    return by * turns.theta, turns.times, by * turns.accelerations, by * turns.rate


@pytest.mark.long
@pytest.mark.parametrize("ground", TURNING.values(), ids=TURNING.keys())
@pytest.mark.parametrize("contact", [None, Contact(0.1)], ids=["rolling", "with contact"])
def test_what_turns_in_a_ground_of_revolution(ground, contact):
    """It is as if the ground turned as a whole, also where the ball slips on it and is resisted by it."""
    turns = PiecewiseAcceleration(0.0, (0.0, 1.0, 2.0), ((0.8,), (-0.5,)), rate=0.5)
    start = BallState(z=(0.5, 0.2), Omega=(0.4, -0.8, 1.3), theta=(0.2,), thetadot=(0.1,))
    runs = [
        simulate(loaded(ground=ground(turns, whole)), TIMES[:4], start, contact=contact, throw=True, **TIGHT)
        for whole in (True, False)
    ]
    for name in ("geometric_centre", "angular_velocity_space", "kinetic_energy", "contact_force"):
        got, wanted = (getattr(run.observables, name) for run in runs)
        np.testing.assert_allclose(got, wanted, atol=1e-7, err_msg=name)
    if contact is not None:
        times = [run.contact.switches.times[: int(run.contact.switches.count)] for run in runs]
        assert len(times[0]) > 0
        np.testing.assert_allclose(*times, atol=1e-8)


def test_belt_has_one_speed_along_waves():
    """The matter of a belt on waves moves along the ground at the speed of its travel, and w follows the contact."""
    ground = HeightField(waves, 0.3, belt=Belt(ConstantRate(0.0, rate=2.0), heading=0.5))
    ball = solid(ground=ground).prepare()
    state = BallState(z=(0.4, -0.3), Omega=(0.3, 0.7, -0.2))
    under = footing(ball, jnp.array(0.0), state)
    np.testing.assert_allclose(jnp.linalg.norm(under.velocity), 2.0, rtol=1e-12)
    np.testing.assert_allclose(jnp.dot(under.velocity, under.normal), 0.0, atol=1e-13)

    def later(step):
        moved = BallState(z=state.z + step * under.coordinate_rates, Omega=state.Omega)
        return footing(ball, jnp.array(step), moved).velocity

    difference = (later(1e-5) - later(-1e-5)) / 2e-5
    np.testing.assert_allclose(under.acceleration, difference, atol=1e-8)


@pytest.mark.long
def test_energy_on_a_belt_over_waves():
    """All balances hold of an unbalanced ball on waves along which a belt runs, and which go up and down."""

    def swelling(t, x, y, size):
        return waves(t, x, y, size) * jnp.cos(0.7 * t)

    ground = HeightField(swelling, 0.2, belt=Belt(Pulse(0.0, height=1.0, rate=1.0), heading=0.4))
    start = BallState(z=(0.5, 0.2), Omega=(0.4, -0.8, 1.3), theta=(0.2,), thetadot=(0.1,))
    report = jaxball.analysis.verify.check_laws(jaxball.Scenario("waves", loaded(ground=ground), start, TIMES[:4]))
    assert report.ok
    assert {row.law for row in report.rows if row.applies} >= {"energy", "momentum", "rolling", "error"}


@pytest.mark.long
@pytest.mark.parametrize(
    "contact", [None, Contact(0.15), Contact(LimitSurface(0.5, 0.3))], ids=["rolls", "slips", "spins"]
)
def test_a_steady_belt_is_a_plane_seen_in_passing(contact):
    """On a belt with a constant velocity all is as on a plane at rest, seen from axes that move with it."""
    v = np.array([1.2 * np.cos(0.6), 1.2 * np.sin(0.6), 0.0])
    body = BallState(Omega=(0.4, -0.8, 3.3), theta=(0.2,), thetadot=(0.1,))
    resistance = Resistance(rolling=0.05, dry=0.01, exact=True)

    def run(belt, V):
        start = body if contact is None else ReleasedState(body, V)
        ball = loaded(resistance=resistance, ground=Ground(belt=belt))
        return simulate(ball, TIMES[:4], start, contact=contact, throw=True, **TIGHT)

    still, carried = (
        run(None, (1.0, -0.5, 0.0)),
        run(Belt(ConstantRate(0.0, rate=1.2), 0.6), np.array([1.0, -0.5, 0.0]) + v),
    )
    np.testing.assert_allclose(carried.state.z, still.state.z + TIMES[:4, None] * v[:2], atol=1e-8)
    np.testing.assert_allclose(carried.state.Omega, still.state.Omega, atol=1e-8)
    count = int(still.history.switches.count)
    assert count > 0 or contact is None
    np.testing.assert_allclose(carried.history.switches.times[:count], still.history.switches.times[:count], atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize("shape", [jaxball.physics.Ellipsoid((1.0, 1.1, 1.5))])
def test_a_convex_body_on_a_steady_belt(shape):
    """Galileo's principle for an ellipsoid, whose contact point is not under its centre."""

    def run(ground):
        egg = jaxball.ConvexBody(mass=1.0, inertia=(0.65, 0.6, 0.4), shape=shape, gravity=G, ground=ground)
        return simulate(egg, TIMES[:4], BallState(Omega=(0.4, -0.8, 1.3)), **TIGHT)

    still, carried = run(None), run(Ground(belt=Belt(ConstantRate(0.0, rate=1.5))))
    np.testing.assert_allclose(carried.state.z, still.state.z + TIMES[:4, None] * np.array([1.5, 0.0]), atol=1e-9)
    np.testing.assert_allclose(carried.state.Omega, still.state.Omega, atol=1e-9)


def test_a_disk_is_set_down_on_a_belt():
    """A solid disk at rest slips on a belt at v until t = k v/(μ g (1 + k)), and then moves at v k/(1 + k)."""
    mu, v, k = 0.2, 3.0, 0.5
    disk = Disk(mass=1.0, inertia=k, gravity=G, ground=Ground(belt=Belt(ConstantRate(0.0, rate=v))))
    run = simulate(disk, TIMES, ReleasedState(DiskState(), (0.0, 0.0, 0.0)), contact=Contact(mu), throw=True, **TIGHT)
    rolls = k * v / (mu * G * (1 + k))
    np.testing.assert_allclose(run.contact.switches.times[0], rolls, rtol=1e-9)
    np.testing.assert_allclose(run.contact.V[-1], [v * k / (1 + k), 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(
        run.state.z[-1], 0.5 * mu * G * rolls**2 + (TIMES[-1] - rolls) * v * k / (1 + k), rtol=1e-9
    )


def test_a_disk_rests_beside_the_lowest_line_of_a_drum_that_speeds_up():
    """In a drum whose wall is accelerated by a, a disk stays at the angle with sin φ = k a/g."""
    k, a, R = 0.5, 2.0, 4.0
    place = R * np.arcsin(k * a / G)
    drum = Cylinder(
        R, axis=(0.0, 1.0, 0.0), belt=Belt(PiecewiseAcceleration(0.0, (0.0, 10.0), ((a,),)), heading=-np.pi / 2)
    )
    disk = Disk(mass=1.0, inertia=k, gravity=G, ground=drum)
    for sign in (1.0, -1.0):
        run = simulate(disk, TIMES, DiskState(z=sign * place), **TIGHT)
        moved = np.max(np.abs(run.state.z - sign * place))
        assert (moved < 1e-9) == (sign > 0)


@pytest.mark.long
@pytest.mark.parametrize("plane", [Ground, TiltingPlane])
def test_friction_against_the_spin_is_relative_to_the_table(plane):
    """A ball over the axis of a turntable gets its rate W after D W/(c N r), and keeps it if |Ẇ| D is below c N r."""
    c, W = 0.1, 2.0
    most = c * G / D
    # Steady until 2, then faster by less and by more than friction can follow, for 1 each.
    turning = PiecewiseAcceleration(0.0, (2.0, 3.0, 4.0), ((0.9 * most,), (1.5 * most,)), rate=W)
    ball = solid(resistance=Resistance(dry_spinning=c, exact=True), ground=plane(turntable=Turntable(turning)))
    times = np.array([0.0, 0.5, 2.5, 3.0, 3.6])
    run = simulate(ball, times, BallState(), throw=True, **TIGHT)
    expected = [0.0, 0.5 * most, W + 0.45 * most, W + 0.9 * most, W + 0.9 * most + 0.6 * most]
    assert D * W / (c * G) < 2.0
    np.testing.assert_allclose(run.state.Omega[:, 2], expected, atol=1e-8)
    np.testing.assert_allclose(run.history.switches.times[:2], [W / most, 3.0], atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("plane", [Ground, TiltingPlane])
def test_a_limit_surface_on_a_turntable(plane):
    """A ball over the axis is spun up by μ N ρ, and so has the rate of the table after D W/(μ N ρ)."""
    mu, rho, W = 0.2, 0.1, 2.0
    ball = solid(ground=plane(turntable=Turntable(ConstantRate(0.0, rate=W))))
    most = mu * G * rho / D
    start = ReleasedState(BallState(), (0.0, 0.0, 0.0))
    run = simulate(ball, [0.0, 1.0, 3.0, 6.0], start, contact=Contact(LimitSurface(mu, rho)), throw=True, **TIGHT)
    expected = np.minimum(W, most * np.array([0.0, 1.0, 3.0, 6.0]))
    np.testing.assert_allclose(run.state.Omega[:, 2], expected, atol=1e-8)
    np.testing.assert_allclose(run.state.z, 0.0, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivatives_by_the_speed_of_a_belt(mode):
    """On waves, by the speed and the heading, against differences."""

    def end(numbers):
        ground = HeightField(waves, 0.3, belt=Belt(ConstantRate(0.0, rate=numbers[0]), heading=numbers[1]))
        return simulate(solid(ground=ground), [0.0, 1.5], BallState(Omega=(0.1, 1.0, 0.0)), **TIGHT).state.z[-1]

    at = jnp.array([0.7, 0.3])
    np.testing.assert_allclose(mode(end)(at), jacobian(end, at, 1e-4, points=2), rtol=1e-6, atol=1e-7)


def test_what_a_disk_may_have(no_type_checks):
    with refuses(ValueError, "ground"):
        Disk(mass=1.0, inertia=0.5, ground=Bowl(3.0, turntable=Turntable(ConstantRate(0.0))))
    across = Disk(mass=1.0, inertia=0.5, ground=Ground(belt=Belt(ConstantRate(0.0), heading=0.3)))
    (problem,) = jaxball.problems(across)
    said(problem, "ground.belt.heading")
    with refuses(TypeError, "belt"):
        Ground(belt=3.0)
    with refuses(TypeError, "travel"):
        Belt(1.0)


def test_belts_side_by_side_one_of_which_stands():
    """Rows are the runs alone, and a belt that does not move is none."""

    def end(ground):
        return simulate(solid(ground=ground), [0.0, 1.5], BallState(Omega=(0.4, -0.8, 1.3)), **TIGHT).state.z[-1]

    def on_belt(speed):
        return end(HeightField(waves, 0.3, belt=Belt(ConstantRate(0.0, rate=speed), 0.3)))

    speeds = jnp.array([0.0, 0.7, -1.2])
    rows = jax.vmap(on_belt)(speeds)
    np.testing.assert_allclose(rows, jnp.stack([on_belt(speed) for speed in speeds]), atol=1e-11)
    np.testing.assert_allclose(rows[0], end(HeightField(waves, 0.3)), atol=1e-11)
