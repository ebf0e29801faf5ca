"""Leaving the plane and slipping, and the extremes of the contact force."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

import jaxball
from jaxball import Ball, BallState, Detachment, Disk, DiskState, Slip, Status, contact_extremes, simulate
from jaxball.physics.dynamics.locked import reaction
from jaxball.simulation.solvers import Gauss
from tests.support.differences import slope
from tests.support.paper import paper_ball, paper_disk
from tests.support.sentences import refuses, said

TIMES = np.linspace(0.0, 20.0, 21)
TIGHT = {"solver": Gauss(8), "rtol": 1e-12, "atol": 1e-12}


@pytest.fixture(scope="module")
def ball():
    """The paper's ball with events of all kinds, and dense output."""
    return simulate(paper_ball(), TIMES, events={"slip": Slip(0.15, terminal=False)}, dense=True, **TIGHT)


@pytest.fixture(scope="module")
def ratio(ball):
    """|f| / N at any time, by way of the observables, which know R as a vector in space."""
    observe = jaxball.jit(lambda t, x: jaxball.observe(ball.system, t, x))

    def at(t):
        return float(observe(jnp.asarray(t), ball.at(t)).friction_ratio)

    return at


@pytest.mark.thorough
def test_slip_is_where_the_friction_is_all_there_is(ball, ratio):
    found = ball.events["slip"]
    first = brentq(lambda t: ratio(t) - 0.15, 5.1, 5.3, xtol=1e-12)
    np.testing.assert_allclose(found.times[0], first, rtol=0, atol=1e-9)
    assert found.count >= 2
    for t in found.times[: found.count]:
        np.testing.assert_allclose(ratio(float(t)), 0.15, atol=1e-9)
        assert ratio(float(t) - 1e-3) < 0.15 < ratio(float(t) + 1e-3)
    assert ball.status == Status.SUCCESS


@pytest.mark.thorough
def test_extremes_of_the_papers_ball(ball, ratio):
    """The figures of the project's physics notes, and a minimiser of SciPy for the place."""
    found = contact_extremes(ball)
    np.testing.assert_allclose(found.least_normal_force, 3.517427, atol=1e-6)
    np.testing.assert_allclose(found.largest_friction, 0.673844, atol=1e-6)
    np.testing.assert_allclose(found.friction_needed, 0.190594, atol=1e-6)
    peak = minimize_scalar(lambda t: -ratio(t), bounds=(6.0, 7.0), method="bounded", options={"xatol": 1e-10})
    np.testing.assert_allclose(found.friction_needed, -peak.fun, rtol=1e-12)
    np.testing.assert_allclose(found.friction_needed_time, peak.x, atol=1e-6)
    np.testing.assert_allclose(found.margin, 3.517427 / 4.0, atol=1e-6)
    assert bool(found.holds)
    assert str(found).startswith("least normal force 3.51742")


@pytest.mark.slow
def test_extremes_of_the_papers_disk():
    """At t = 19.397 the friction ratio is 0.295097."""
    found = contact_extremes(simulate(paper_disk(), TIMES, dense=True, **TIGHT))
    np.testing.assert_allclose(found.friction_needed, 0.295097, atol=1e-6)
    np.testing.assert_allclose(found.friction_needed_time, 19.397, atol=1e-3)
    np.testing.assert_allclose(found.least_normal_force, 4.40228, atol=1e-5)


@pytest.mark.slow
def test_extremes_do_not_depend_on_the_saved_times(ball):
    few = contact_extremes(simulate(paper_ball(), [0.0, 20.0], dense=True, **TIGHT))
    np.testing.assert_allclose(few.friction_needed, contact_extremes(ball).friction_needed, rtol=1e-11)


def wheel(speed):
    """A disk with its centre of mass off the centre, at the bottom, and how fast it rolls there."""
    return Disk(mass=1.0, inertia=0.3, offset=(0.0, 0.0, -0.4)), DiskState(phidot=speed)


def normal_force(disk, phi, speed):
    """N of a disk without masses by energy and Newton: N = M (g − d/dt² of the height of the centre of mass)."""
    M, d, r, g, h = (float(x) for x in (disk.mass, disk.inertia, disk.radius, disk.gravity, 0.4))

    def inertia(phi):
        return d + M * (r**2 + h**2 - 2 * r * h * np.cos(phi))

    energy = 0.5 * inertia(0.0) * speed**2 - M * g * h
    rate2 = 2 * (energy + M * g * h * np.cos(phi)) / inertia(phi)
    slope = -M * g * h * np.sin(phi) / inertia(phi) - rate2 * M * r * h * np.sin(phi) / inertia(phi)
    return M * (g + h * (np.cos(phi) * rate2 + np.sin(phi) * slope))


@pytest.mark.thorough
def test_a_fast_wheel_leaves_the_plane():
    """The mass at the top pulls it up. The place is known from energy and Newton's law for the centre of mass."""
    disk, state = wheel(4.0)
    run = simulate(disk, TIMES, state, events={"lift": Detachment()}, **TIGHT)
    phi = brentq(lambda phi: normal_force(disk, phi, 4.0), 0.0, np.pi)
    assert run.status == Status.DETACHED
    assert not run.ok
    np.testing.assert_allclose(run.events["lift"].state.phi[0], phi, atol=1e-9)
    said(run.message)
    np.testing.assert_array_equal(np.isfinite(run.state.phi), run.reached >= TIMES)


def closed_time_of_detachment(speed):
    """How long the wheel takes to the place where N is zero, by energy alone."""
    disk, _ = wheel(speed)
    M, d, r, g, h = (float(x) for x in (disk.mass, disk.inertia, disk.radius, disk.gravity, 0.4))
    start = d + M * (r - h) ** 2

    def slowness(phi):
        inertia = d + M * (r**2 + h**2 - 2 * r * h * np.cos(phi))
        return np.sqrt(inertia / (start * speed**2 - 2 * M * g * h * (1 - np.cos(phi))))

    lift = brentq(lambda phi: normal_force(disk, phi, speed), 0.0, np.pi, xtol=1e-14)
    return quad(slowness, 0.0, lift, epsabs=0.0, epsrel=1e-13)[0]


@pytest.mark.long
@pytest.mark.parametrize("mode", ["reverse", pytest.param("forward", marks=pytest.mark.slow)])
def test_the_time_of_detachment_is_differentiable(mode):
    """Beside places for eight detachments, of which one is used; 0 · ∞ came back from the others in reverse mode."""

    def time(speed, adjoint=None):
        disk, state = wheel(speed)
        settings = {"rtol": 1e-12, "atol": 1e-12, "max_steps": 64, "adjoint": adjoint}
        return simulate(disk, TIMES[:3], state, events={"lift": Detachment()}, **settings).events["lift"].times[0]

    if mode == "reverse":
        found, rate = jaxball.jit(jax.value_and_grad(time))(4.0)
    else:
        found, rate = jaxball.jit(lambda v: jax.jvp(lambda v: time(v, diffrax.ForwardMode()), (v,), (1.0,)))(4.0)
    np.testing.assert_allclose(found, closed_time_of_detachment(4.0), rtol=1e-10)
    np.testing.assert_allclose(rate, slope(closed_time_of_detachment, 4.0, 1e-3), rtol=1e-8)


def closed_friction_needed(speed):
    """The largest |f| / N of the wheel by energy and Newton: f = M times the acceleration of the centre of mass."""
    disk, _ = wheel(speed)
    M, d, r, g, h = (float(x) for x in (disk.mass, disk.inertia, disk.radius, disk.gravity, 0.4))

    def ratio(phi):
        inertia = d + M * (r**2 + h**2 - 2 * r * h * np.cos(phi))
        start = d + M * (r - h) ** 2
        rate2 = (start * speed**2 - 2 * M * g * h * (1 - np.cos(phi))) / inertia
        slope = -M * h * np.sin(phi) * (g + r * rate2) / inertia
        friction = M * (slope * (h * np.cos(phi) - r) - h * np.sin(phi) * rate2)
        return abs(friction) / normal_force(disk, phi, speed)

    turn = np.arccos(1 - (d + M * (r - h) ** 2) * speed**2 / (2 * M * g * h))
    grid = np.linspace(0.0, turn, 401)
    best = grid[np.argmax([ratio(phi) for phi in grid])]
    bounds = max(best - 0.01, 0.0), min(best + 0.01, turn)
    return max(ratio(turn), -minimize_scalar(lambda phi: -ratio(phi), bounds=bounds, method="bounded").fun)


@pytest.mark.thorough
def test_the_derivative_of_the_friction_needed():
    """Against the closed form; the place of a maximum found by values alone left an error of some 1e-7."""

    def needed(speed, adjoint=None):
        disk, state = wheel(speed)
        run = simulate(disk, [0.0, 5.0], state, dense=True, adjoint=adjoint, max_steps=64, rtol=1e-12, atol=1e-12)
        return contact_extremes(run).friction_needed

    speed = 0.9
    value, expected = closed_friction_needed(speed), slope(closed_friction_needed, speed, 1e-3)
    found, forward = jaxball.jit(lambda v: jax.jvp(lambda v: needed(v, diffrax.ForwardMode()), (v,), (1.0,)))(speed)
    np.testing.assert_allclose(found, value, rtol=1e-11)
    np.testing.assert_allclose(forward, expected, rtol=0, atol=1e-9)


@pytest.mark.thorough
def test_a_run_that_detaches_at_its_start_keeps_its_start():
    disk, _ = wheel(0.0)
    run = simulate(disk, TIMES, DiskState(phi=np.pi, phidot=2.5), events={"lift": Detachment()})
    assert run.status == Status.DETACHED
    assert run.reached == 0.0
    assert run.events["lift"].count == 1
    np.testing.assert_array_equal(np.isfinite(run.state.phi), TIMES == 0.0)


@pytest.mark.thorough
def test_reaction_is_the_size_of_the_force_in_space():
    rng = np.random.default_rng(7)
    ball = paper_ball()
    for _ in range(5):
        q = rng.normal(size=4)
        state = BallState(q=q / np.linalg.norm(q), Omega=rng.normal(size=3))
        t = jnp.asarray(rng.uniform(0.0, 20.0))
        seen, found = jaxball.observe(ball, t, state), reaction(ball, t, state)
        np.testing.assert_allclose(found.normal, seen.normal_force, rtol=1e-12)
        np.testing.assert_allclose(found.friction, np.linalg.norm(seen.friction), rtol=1e-11)


class TestArguments:
    def test_extremes_need_dense_output(self):
        run = simulate(Ball(mass=1.0, inertia=(0.4, 0.4, 0.4)), [0.0, 1.0])
        with refuses(ValueError, "trajectory"):
            contact_extremes(run)

    def test_no_plane_no_detachment(self):
        top = jaxball.physics.classical.FreeRigidBody(inertia=(1.0, 2.0, 3.0))
        with refuses(TypeError, "lift"):
            simulate(top, [0.0, 1.0], events={"lift": Detachment()})


@pytest.mark.parametrize("mu", [-0.3, 0.0, np.nan, np.inf])
def test_what_is_no_coefficient_of_friction(mu):
    with refuses(ValueError, "friction"):
        Slip(mu)


def test_a_traced_coefficient_is_not_looked_at():
    assert jax.eval_shape(Slip, jax.ShapeDtypeStruct((), jnp.float64)).capacity == 8


@pytest.mark.parametrize(
    "make", [lambda: Slip(0.3, capacity=0), lambda: Detachment(capacity=0)], ids=["slip", "detachment"]
)
def test_events_without_room(make):
    with refuses(ValueError, "capacity"):
        make()
