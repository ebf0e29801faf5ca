"""Slips that begin from rolling, from an impact and anew, and end: errors in proportion to the tolerance, no floor."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Contact
from jaxball.physics import ReleasedState, SwitchCause
from tests.support import slipping_bodies
from tests.support.differences import slope

TOLERANCES = [10.0**-k for k in range(4, 13)]
FINEST = 1e-13
# Errors over tolerances: measured, at most 7 in times and 16 at the end.
MOST = 50
SLOW = pytest.mark.slow
BODIES = [
    pytest.param(slipping_bodies.masses_on_a_slope, Contact(0.2, 0.22, 0.3), id="masses on a slope"),
    pytest.param(slipping_bodies.masses_on_a_slope, Contact(0.19), id="without acceleration", marks=SLOW),
    pytest.param(slipping_bodies.free_pendulum, Contact(0.1, 0.11), id="free pendulum", marks=SLOW),
    pytest.param(slipping_bodies.motors, Contact(0.06, 0.065), id="motors", marks=SLOW),
    pytest.param(slipping_bodies.all_resistances, Contact(0.2, 0.22, 0.3), id="all resistances", marks=SLOW),
    pytest.param(slipping_bodies.shaken_turning_plane, Contact(0.15, 0.18, 0.3), id="moving plane", marks=SLOW),
    pytest.param(slipping_bodies.disk, Contact(0.2, 0.25, 0.3), id="disk that bounces", marks=SLOW),
]


def simulated(case, law, tolerance, solver=None):
    return jaxball.simulate(
        case.body,
        [0.0, case.end],
        case.state,
        contact=law,
        rtol=tolerance,
        atol=tolerance,
        max_steps=2000,
        **({} if solver is None else {"solver": solver}),
    )


def end_of(run):
    return np.concatenate([np.ravel(leaf[-1]) for leaf in jax.tree.leaves((run.state, run.contact.V))])


def require_close(run, fine, tolerance):
    """The same switches as those of the finest run, and errors in proportion to the tolerance."""
    switches, exact = run.contact.switches, fine.contact.switches
    count = int(exact.count)
    assert run.ok
    assert int(switches.count) == count
    np.testing.assert_array_equal(switches.cause, exact.cause)
    off = np.abs(np.asarray(switches.times)[:count] - np.asarray(exact.times)[:count])
    assert np.max(off) <= MOST * tolerance
    assert np.max(np.abs(end_of(run) - end_of(fine))) <= MOST * tolerance


@pytest.mark.long
@pytest.mark.parametrize(("kind", "law"), BODIES)
def test_errors_are_in_proportion_to_the_tolerance(kind, law):
    case = kind()
    fine = simulated(case, law, FINEST)
    assert SwitchCause.GIVES_WAY in np.asarray(fine.contact.switches.cause)
    for tolerance in TOLERANCES:
        require_close(simulated(case, law, tolerance), fine, tolerance)


@pytest.mark.slow
def test_a_method_with_a_small_region_of_stability_follows_slips_to_their_ends():
    """Beside the speed of a slip that ends, friction turns it ever faster: a stiff end for Adams methods."""
    case, law = slipping_bodies.masses_on_a_slope(), Contact(0.2, 0.22, 0.3)
    fine = simulated(case, law, FINEST)
    for tolerance in (1e-5, 1e-6, 1e-7, 1e-8):
        require_close(simulated(case, law, tolerance, jaxball.simulation.solvers.Adams()), fine, tolerance)


@pytest.mark.slow
def test_a_body_that_lifts_slowly_does_not_land_again_by_rounding():
    """The first, shortest steps of a multistep method leave the plane by less than rounding."""
    case, law = slipping_bodies.disk(), Contact(0.2, 0.25, 0.3)
    causes = np.asarray(simulated(case, law, FINEST).contact.switches.cause)
    for tolerance in (1e-6, 1e-10):
        run = simulated(case, law, tolerance, jaxball.simulation.solvers.Adams())
        np.testing.assert_array_equal(run.contact.switches.cause, causes)


@pytest.mark.long
def test_what_friction_takes_is_what_the_energy_loses():
    """On a plane at rest, without joints that move, at every tolerance."""
    case = slipping_bodies.masses_on_a_slope()
    still = jaxball.Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), offset=(0.15, 0.1, -0.2), ground=jaxball.Ground(0.3, 0.4))
    for tolerance in (1e-6, 1e-8, 1e-10):
        run = simulated(case._replace(body=still), Contact(0.1, 0.11), tolerance)
        energy = run.observables.energy
        assert run.ok
        assert run.contact.friction_loss[-1] > 0.01
        np.testing.assert_allclose(energy + run.contact.friction_loss, energy[0], rtol=0, atol=MOST * tolerance)


def end_of_slip(mu, tolerance, height):
    """When a homogeneous ball with slip and spin about all axes begins to roll, on the plane or dropped on it."""
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4))
    start = ReleasedState(jaxball.BallState(q=(0.6, 0.0, 0.8, 0.0), Omega=(0.5, -1.0, 0.7)), (1.0, 0.4, 0.0), height)
    run = jaxball.simulate(
        ball,
        jnp.array([0.0, 8.0]),
        start,
        contact=Contact(mu, restitution=0.3),
        adjoint=diffrax.ForwardMode(),
        rtol=tolerance,
        atol=tolerance,
    )
    switches = run.contact.switches
    return switches.times[jnp.argmax(switches.cause == SwitchCause.STOPS)]


@pytest.mark.long
@pytest.mark.parametrize("height", [0.0, pytest.param(0.3, marks=SLOW)])
def test_the_derivative_of_the_time_at_which_a_slip_ends(height):
    """t is in inverse proportion to μ, also after bounces, by which the mean normal force stays the weight."""
    time_and_rate = jaxball.jit(
        lambda mu, tolerance: jax.jvp(lambda mu: end_of_slip(mu, tolerance, height), (mu,), (1.0,))
    )
    for tolerance, close in ((1e-8, 1e-6), (1e-10, 1e-8), (1e-12, 1e-9)):
        time, rate = time_and_rate(0.2, tolerance)
        assert float(rate) == pytest.approx(-float(time) / 0.2, abs=close)


def masses_by_friction(mu):
    """A coefficient of friction of a ball with masses, on a slope."""
    case = slipping_bodies.masses_on_a_slope()
    return case, Contact(mu, 1.1 * mu, 0.3), case.state


def pendulum_by_restitution(e):
    """The restitution of a ball with a free pendulum that is dropped, bounces, slips, and rolls in the end."""
    pendulum = jaxball.spherical_pendulum(0.5, 0.6, drives=(jaxball.Damper(0.02), None))
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), offset=(0.0, 0.0, -0.05), mechanisms=[pendulum])
    state = jaxball.BallState(theta=(0.9, 0.7), thetadot=(0.0, 1.5), Omega=(0.5, -1.0, 0.7))
    start = ReleasedState(state, V=(0.6, 0.3, 0.0), height=0.5)
    return slipping_bodies.Case(ball, state, 4.0), Contact(0.2, 0.22, e), start


@pytest.mark.slow
@pytest.mark.parametrize(("given", "at"), [(masses_by_friction, 0.2), (pendulum_by_restitution, 0.3)])
def test_derivatives_of_all_switches_at_the_default_tolerance(given, at):
    """By a coefficient, against differences over six points of runs at the finest tolerance."""

    def switches(x, tolerance, adjoint):
        case, law, start = given(x)
        settings = {"contact": law, "adjoint": adjoint, "rtol": tolerance, "atol": tolerance}
        return jaxball.simulate(case.body, jnp.array([0.0, case.end]), start, **settings).contact.switches

    values = jaxball.jit(lambda x: switches(x, FINEST, diffrax.RecursiveCheckpointAdjoint()))
    count = int(values(at).count)
    differences = slope(lambda x: values(x).times, at, 1e-4, points=6)
    found = jaxball.jit(jax.jacfwd(lambda x: switches(x, 1e-10, diffrax.ForwardMode()).times))(at)
    assert count > 5
    np.testing.assert_allclose(found[:count], differences[:count], rtol=0, atol=1e-8)


@pytest.mark.thorough
def test_an_impact_at_the_start_is_a_switch():
    """So that what the switches lost adds up to what impacts took."""
    disk = jaxball.Disk(mass=1.0, inertia=0.5)
    falling = ReleasedState(jaxball.DiskState(phidot=1.0), V=(1.0, 0.0, -2.0))
    run = jaxball.simulate(disk, [0.0, 3.0], falling, contact=Contact(0.2, restitution=0.5, slowest=0.2))
    switches = run.contact.switches
    first = switches.cause[0], switches.source[0], switches.target[0]
    assert first == (SwitchCause.LANDS, jaxball.physics.Mode.FLIGHT, jaxball.physics.Mode.FLIGHT)
    assert float(switches.times[0]) == 0.0
    lost = np.asarray(switches.lost)[: int(switches.count)]
    np.testing.assert_allclose(np.sum(lost), run.contact.impact_loss[-1], rtol=1e-12)


@pytest.mark.slow
def test_a_slip_that_friction_nearly_holds_ends():
    """Its direction returns much faster than it slows down, so that steps are too short to halve its speed."""
    versor = np.array([0.846, 0.267, 0.238, -0.395])
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), gravity=9.81, offset=(-0.018, -0.098, 0.171))
    state = jaxball.BallState(q=versor / np.linalg.norm(versor), Omega=(0.732, -0.425, -1.695))
    case = slipping_bodies.Case(ball, ReleasedState(state, V=(-0.48, -0.841, 0.0)), 2.0)
    law = Contact(friction=0.112)
    implicit = simulated(case, law, 1e-11, solver=jaxball.simulation.solvers.RadauIIA())
    assert implicit.contact.switches.cause[:3].tolist() == [SwitchCause.STOPS, SwitchCause.GIVES_WAY, SwitchCause.STOPS]
    for tolerance in (1e-8, 1e-10):
        require_close(simulated(case, law, tolerance), implicit, tolerance)
