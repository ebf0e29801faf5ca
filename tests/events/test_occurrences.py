"""When events happen, on motions whose times are known in closed form."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import jaxball
from jaxball import Disk, DiskState, Event, Status, simulate
from jaxball.physics.classical import FreeRigidBody, RigidBodyState
from jaxball.simulation.solvers import Gauss
from tests.support.differences import slope
from tests.support.sentences import refuses, said

END = 12.0
INERTIA = np.array([1.0, 2.0, 3.0])
TIMES = np.linspace(0.0, END, 13)


def middle(system, t, state):
    """Ω2, which is −a sn(bt)."""
    return state.Omega[1]


def between(system, t, state):
    """(t − 5)(t − 5.02), negative for a fiftieth of a unit of time."""
    return (t - 5.0) * (t - 5.02)


def late(system, t, state):
    return t - 50.0


def elliptic():
    """Ω(t) = (A cn, −B sn, C dn)(bt | m) for the body that starts with Ω = (0.4, 0, 1.5), Landau & Lifshitz § 37."""
    d, w = INERTIA, np.array([0.4, 0.0, 1.5])
    energy, momentum = d @ w**2, d**2 @ w**2
    b = np.sqrt((d[2] - d[1]) * (momentum - energy * d[0]) / np.prod(d))
    m = (d[1] - d[0]) * (energy * d[2] - momentum) / ((d[2] - d[1]) * (momentum - energy * d[0]))
    return b, m


START = RigidBodyState(Omega=(0.4, 0.0, 1.5))
SECTIONS = {
    "middle": Event(middle),
    "up": Event(middle, direction=1),
    "down": Event(middle, direction=-1, capacity=2),
    "between": Event(between),
    "late": Event(late),
}


def zeros():
    """The zeros of sn after the start, 2kK / b."""
    b, m = elliptic()
    period = 2 * ellipk(m) / b
    return period * np.arange(1, int(END / period) + 1)


@pytest.mark.thorough
def test_the_closed_form_is_that_of_the_body(runs):
    b, m = elliptic()
    sn, cn, dn, _ = ellipj(b * TIMES, m)
    Omega = runs["sections"].state.Omega
    np.testing.assert_allclose(Omega[:, 0], 0.4 * cn, atol=1e-9)
    np.testing.assert_allclose(Omega[:, 2], 1.5 * dn, atol=1e-9)
    assert np.max(np.abs(np.abs(Omega[:, 1]) - np.abs(sn) * np.max(np.abs(Omega[:, 1])))) < 0.1


@pytest.fixture(scope="module")
def runs():
    body = FreeRigidBody(inertia=INERTIA)
    return {
        "sections": simulate(body, TIMES, START, events=SECTIONS),
        "gauss": simulate(
            body, TIMES, START, events={"middle": Event(middle)}, solver=Gauss(8), rtol=1e-12, atol=1e-12
        ),
        "ended": simulate(body, TIMES, START, events={"a": Event(middle, terminal=True), "b": Event(between)}),
    }


@pytest.mark.thorough
def test_every_crossing_is_found_and_the_start_is_none(runs):
    found, expected = runs["sections"].events["middle"], zeros()
    assert len(expected) >= 4
    assert found.count == len(expected)
    np.testing.assert_allclose(found.times[: len(expected)], expected, rtol=0, atol=2e-8)
    assert np.all(np.isnan(found.times[len(expected) :]))
    np.testing.assert_allclose(found.state.Omega[: len(expected), 1], 0.0, atol=1e-14)
    np.testing.assert_allclose(np.abs(found.state.Omega[: len(expected), 0]), 0.4, atol=1e-8)


@pytest.mark.thorough
def test_a_tighter_solver_makes_times_more_accurate(runs):
    found, expected = runs["gauss"].events["middle"], zeros()
    np.testing.assert_allclose(found.times[: len(expected)], expected, rtol=0, atol=3e-12)


@pytest.mark.thorough
def test_directions_take_turns(runs):
    events, expected = runs["sections"].events, zeros()
    np.testing.assert_allclose(events["up"].times[: len(expected) // 2], expected[1::2], atol=2e-8)
    assert events["up"].count + events["down"].count == events["middle"].count
    np.testing.assert_allclose(events["down"].times, expected[:3:2], atol=2e-8)


@pytest.mark.thorough
def test_two_crossings_close_together_are_both_found(runs):
    found = runs["sections"].events["between"]
    assert found.count == 2
    np.testing.assert_allclose(found.times[:2], [5.0, 5.02], atol=1e-12)


@pytest.mark.slow
def test_sentences(runs):
    events = runs["sections"].events
    assert events["late"].count == 0
    said(events["late"].message, "-50", "-38")
    said(events["middle"].message, f"{len(zeros())} times")
    few = Event(middle, capacity=1)
    said(simulate(FreeRigidBody(inertia=INERTIA), TIMES, START, events={"few": few}).events["few"].message, "1")


@pytest.mark.thorough
def test_a_terminal_event_ends_the_run(runs):
    run, first = runs["ended"], zeros()[0]
    assert run.status == Status.EVENT
    assert run.ok
    np.testing.assert_allclose(run.reached, first, atol=2e-8)
    np.testing.assert_array_equal(np.isfinite(run.state.Omega[:, 0]), first >= TIMES)
    assert run.events["b"].count == (2 if first > 5.02 else 0)
    said(run.message)


def test_extreme_values_are_those_up_to_the_end_of_the_run():
    """A free disk rolls at 1 to z = 1.5 in a step that goes on to 2, where an event ends the run."""
    rolling = {"there": Event("z", level=1.5, terminal=True)}
    others = {
        "far": Event("z", level=9.0),
        "up": Event(lambda disk, t, state: 0.7 - state.z, direction=1),
        "ahead": Event(lambda disk, t, state: state.z + 1.0, direction=-1),
    }
    run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 2.0], DiskState(phidot=-1.0), events=rolling | others)
    extremes = {"there": (-1.5, 0.0), "far": (-9.0, -7.5), "up": (-0.8, 0.7), "ahead": (1.0, 2.5)}
    found = {name: (float(event.least), float(event.largest)) for name, event in run.events.items()}
    for name, expected in extremes.items():
        np.testing.assert_allclose(found[name], expected, rtol=0, atol=1e-12)
    said(run.events["far"].message, "-7.5")
    said(run.events["up"].message, "direction")


def time_of_first_crossing(w):
    run = simulate(
        FreeRigidBody(inertia=INERTIA),
        TIMES,
        RigidBodyState(Omega=jnp.stack([w, jnp.zeros_like(w), jnp.full_like(w, 1.5)])),
        events={"middle": Event(middle, capacity=4)},
        adjoint=diffrax.ForwardMode(),
        max_steps=256,
    )
    return run.events["middle"].times[0]


@pytest.mark.long
def test_times_are_differentiable():
    """Against the closed form: T = 2K(m)/b depends on the initial Ω1."""

    def closed(w):
        d, Omega = INERTIA, np.array([w, 0.0, 1.5])
        energy, momentum = d @ Omega**2, d**2 @ Omega**2
        m = (d[1] - d[0]) * (energy * d[2] - momentum) / ((d[2] - d[1]) * (momentum - energy * d[0]))
        return 2 * ellipk(m) / np.sqrt((d[2] - d[1]) * (momentum - energy * d[0]) / np.prod(d))

    expected = slope(closed, 0.4, 1e-4, points=2)
    found = jaxball.jit(jax.jacfwd(time_of_first_crossing))(0.4)
    np.testing.assert_allclose(found, expected, rtol=3e-7)


@pytest.mark.slow
def test_lanes_of_a_batch_are_single_runs():
    time = jax.jit(time_of_first_crossing)
    w = np.array([0.3, 0.4, 0.5])
    np.testing.assert_allclose(jax.jit(jax.vmap(time))(w), [time(x) for x in w], rtol=1e-8)


@pytest.mark.usefixtures("no_type_checks")
class TestArguments:
    def test_events_must_be_named(self):
        with refuses(TypeError, "events['a']"):
            simulate(FreeRigidBody(inertia=INERTIA), TIMES, START, events={"a": middle})

    @pytest.mark.parametrize("of", [lambda system, t, state: state.Omega, lambda system, t, state: t > 1.0])
    def test_an_event_is_one_real_number(self, of):
        with refuses(TypeError, "of"):
            simulate(FreeRigidBody(inertia=INERTIA), TIMES, START, events={"a": Event(of)})

    @pytest.mark.parametrize(
        ("make", "named"),
        [
            (lambda: Event(middle, direction=2), "direction"),
            (lambda: Event(middle, capacity=0), "capacity"),
        ],
    )
    def test_what_an_event_can_be(self, make, named):
        with refuses(ValueError, named):
            make()
