"""Slips that begin from rolling, from an impact and anew, and end: errors in proportion to the tolerance, no floor."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Contact, ReleasedState
from tests.support import slipping_bodies

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


def simulated(case, law, tolerance):
    return jaxball.simulate(
        case.body, [0.0, case.end], case.state, contact=law, rtol=tolerance, atol=tolerance, max_steps=2000
    )


def end_of(run):
    return np.concatenate([np.ravel(leaf[-1]) for leaf in jax.tree.leaves((run.state, run.contact.V))])


@pytest.mark.parametrize(("kind", "law"), BODIES)
def test_errors_are_in_proportion_to_the_tolerance(kind, law):
    case = kind()
    fine = simulated(case, law, FINEST)
    count, switches = int(fine.contact.switches.count), fine.contact.switches
    assert fine.ok
    assert jaxball.Cause.GIVES_WAY in np.asarray(switches.cause[:count])
    for tolerance in TOLERANCES:
        run = simulated(case, law, tolerance)
        assert run.ok
        assert int(run.contact.switches.count) == count
        np.testing.assert_array_equal(run.contact.switches.cause, switches.cause)
        off = np.abs(np.asarray(run.contact.switches.times)[:count] - np.asarray(switches.times)[:count])
        assert np.max(off) <= MOST * tolerance
        assert np.max(np.abs(end_of(run) - end_of(fine))) <= MOST * tolerance


def test_what_friction_takes_is_what_the_energy_loses():
    """On a plane at rest, without joints that move, at every tolerance."""
    case = slipping_bodies.masses_on_a_slope()
    still = jaxball.Ball(mass=1.0, inertia=(0.4, 0.45, 0.5), offset=(0.15, 0.1, -0.2), ground=jaxball.Ground(0.3, 0.4))
    for tolerance in (1e-6, 1e-8, 1e-10):
        run = simulated(case._replace(body=still), Contact(0.1, 0.11), tolerance)
        energy = run.observables.energy
        assert run.ok
        assert run.contact.rubbed[-1] > 0.01
        np.testing.assert_allclose(energy + run.contact.rubbed, energy[0], rtol=0, atol=MOST * tolerance)


def thrown_ball(mu, tolerance):
    """When a homogeneous ball with slip and spin about all axes begins to roll."""
    ball = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4))
    start = ReleasedState(jaxball.BallState(q=(0.6, 0.0, 0.8, 0.0), Omega=(0.5, -1.0, 0.7)), (1.0, 0.4, 0.0))
    run = jaxball.simulate(
        ball,
        jnp.array([0.0, 8.0]),
        start,
        contact=Contact(mu),
        adjoint=diffrax.ForwardMode(),
        rtol=tolerance,
        atol=tolerance,
    )
    return run.contact.switches.times[0]


def test_the_derivative_of_the_time_at_which_a_slip_ends():
    """t is in inverse proportion to μ."""
    time_and_rate = jax.jit(lambda mu, tolerance: jax.jvp(lambda mu: thrown_ball(mu, tolerance), (mu,), (1.0,)))
    for tolerance, close in ((1e-8, 1e-6), (1e-10, 1e-8), (1e-12, 1e-9)):
        time, rate = time_and_rate(0.2, tolerance)
        assert float(rate) == pytest.approx(-float(time) / 0.2, abs=close)


@pytest.mark.slow
def test_derivatives_of_all_switches_at_the_default_tolerance():
    """By a coefficient of friction, against differences over six points of runs at the finest tolerance."""
    case, count, h = slipping_bodies.masses_on_a_slope(), 6, 1e-4

    def times(mu, tolerance, adjoint):
        law, end = Contact(mu, 1.1 * mu, 0.3), jnp.array([0.0, case.end])
        run = jaxball.simulate(case.body, end, case.state, contact=law, adjoint=adjoint, rtol=tolerance, atol=tolerance)
        return run.contact.switches.times[:count]

    values = jax.jit(lambda mu: times(mu, FINEST, diffrax.RecursiveCheckpointAdjoint()))
    one, two, three = (values(0.2 + m * h) - values(0.2 - m * h) for m in (1, 2, 3))
    differences = (45 * one - 9 * two + three) / (60 * h)
    found = jax.jit(jax.jacfwd(lambda mu: times(mu, 1e-10, diffrax.ForwardMode())))(0.2)
    np.testing.assert_allclose(found, differences, rtol=0, atol=1e-8)


def test_an_impact_at_the_start_is_a_switch():
    """So that what the switches lost adds up to what impacts took."""
    disk = jaxball.Disk(mass=1.0, inertia=0.5)
    falling = ReleasedState(jaxball.DiskState(phidot=1.0), V=(1.0, 0.0, -2.0))
    run = jaxball.simulate(disk, [0.0, 3.0], falling, contact=Contact(0.2, restitution=0.5, slowest=0.2))
    switches = run.contact.switches
    first = switches.cause[0], switches.source[0], switches.target[0]
    assert first == (jaxball.Cause.LANDS, jaxball.Mode.FLIGHT, jaxball.Mode.FLIGHT)
    assert float(switches.times[0]) == 0.0
    lost = np.asarray(switches.lost)[: int(switches.count)]
    np.testing.assert_allclose(np.sum(lost), run.contact.struck[-1], rtol=1e-12)
