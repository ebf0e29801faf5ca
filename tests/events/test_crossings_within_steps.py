"""Every crossing within a step, on a disk that rolls freely, z = −φ̇ t, in a few long steps."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Disk, DiskState, Event, Status, simulate
from jaxball.simulation.ensemble import simulate_ensemble
from tests.support.sentences import refuses

END = 2.0
DISK, START = Disk(mass=1.0, inertia=0.5), DiskState(phidot=-1.0)


def level(place):
    return lambda disk, t, state: state.z - place


def twins(disk, t, state):
    return (state.z - 1.0) * (state.z - 1.001)


def waves(disk, t, state):
    return jnp.sin(40.0 * state.z)


def ripples(disk, t, state):
    """A period is about a thousandth of the longest step."""
    return jnp.sin(6000.0 * state.z)


def touch(disk, t, state):
    return (state.z - 1.0) ** 2


def cube(disk, t, state):
    return (state.z - 1.0) ** 3


def both_ends(disk, t, state):
    return state.z * (state.z - END)


def bump(disk, t, state):
    return jnp.exp(-(((state.z - 1.01) / 0.02) ** 2)) - 0.5


def jump(disk, t, state):
    return jnp.where(state.z < 0.7, -1.0, 2.0)


def corner(disk, t, state):
    return jnp.abs(state.z - 1.2) - 0.3


def logarithm(disk, t, state):
    return jnp.log(state.z - 1.0) + 2.0


def noise(disk, t, state):
    return jnp.sin(1e7 * state.z)


PLACES = {
    twins: [1.0, 1.001],
    waves: np.pi / 40 * np.arange(1, 26),
    touch: [],
    cube: [1.0],
    both_ends: [END],
    bump: [1.01 - 0.02 * np.sqrt(np.log(2)), 1.01 + 0.02 * np.sqrt(np.log(2))],
    jump: [0.7],
    corner: [0.9, 1.5],
    logarithm: [1.0 + np.exp(-2.0)],
}
RIPPLES = {ripples: np.pi / 6000 * np.arange(1, 3820)}


def run(functions, tolerance, capacity):
    events = {of.__name__: Event(of, capacity=capacity) for of in functions}
    return simulate(DISK, [0.0, END], START, events=events, rtol=tolerance, atol=tolerance)


def assert_every_crossing_is_found(places_of, events):
    for of, places in places_of.items():
        found = events[of.__name__]
        assert (int(found.count), int(found.unresolved)) == (len(places), 0), of.__name__
        # A zero of order three is only known to the third root of rounding; the disk's steps are exact to rounding.
        accuracy = 1e-5 if of is cube else 1e-13
        np.testing.assert_allclose(found.times[: len(places)], places, rtol=0, atol=accuracy, err_msg=of.__name__)
        assert np.all(np.isnan(found.times[len(places) :]))


@pytest.mark.thorough
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-10])
def test_every_crossing_is_found_in_order(tolerance):
    assert_every_crossing_is_found(PLACES, run(PLACES, tolerance, 40).events)


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-10])
def test_what_changes_too_quickly_is_said(tolerance):
    """Beside it, where all pieces are as small as can be, thousands of crossings of another function are found."""
    events = run([*RIPPLES, noise], tolerance, 4000).events
    assert_every_crossing_is_found(RIPPLES, events)
    assert events["noise"].unresolved > 1000
    assert "never" not in events["noise"].message
    assert "more may have been missed: its function, which was between" in events["noise"].message


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-10])
def test_swings_that_fill_a_run_do_not_look_like_a_constant(tolerance):
    """sin(w z) has ⌊2 w/π⌋ zeros, up to 119 in each of the longest pieces; a sample of 8 tells nothing of them."""

    def counts(w):
        waves = Event(lambda disk, t, state: jnp.sin(w * state.z), capacity=1)
        found = simulate(DISK, [0.0, END], START, events={"waves": waves}, rtol=tolerance, atol=tolerance)
        return found.events["waves"].count, found.events["waves"].unresolved

    rates = np.linspace(50.0, 6000.0, 501) + 0.123
    found, unresolved = jax.vmap(counts)(jnp.asarray(rates))
    np.testing.assert_array_equal(found, np.floor(rates * END / np.pi))
    assert not np.any(unresolved)


@pytest.mark.long
def test_few_crossings_are_found_beside_many():
    assert_every_crossing_is_found(PLACES | RIPPLES, run(PLACES | RIPPLES, 1e-6, 4000).events)


def half(disk, t, state):
    return state.z - 1.5


def three_halves(disk, t, state):
    return 2.0 * state.z - 3.0


def early(disk, t, state):
    return state.z - 1.1


@pytest.mark.thorough
@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("saves", [2, 3, 201])
def test_the_first_of_all_terminal_events_ends_the_run(reverse, saves):
    events = {"late": Event(half, terminal=True), "early": Event(early, terminal=True), "waves": Event(waves)}
    if reverse:
        events = dict(reversed(events.items()))
    run = simulate(DISK, np.linspace(0.0, END, saves), START, events=events)
    assert (run.status, run.events["early"].count, run.events["late"].count) == (Status.EVENT, 1, 0)
    np.testing.assert_allclose(run.reached, 1.1, rtol=0, atol=1e-14)
    # Of the other events those before that: k π/40 < 1.1 up to k = 14.
    assert run.events["waves"].count == 14
    np.testing.assert_array_equal(np.isfinite(run.state.z), run.times <= 1.1)


@pytest.mark.thorough
@pytest.mark.parametrize("terminal", [False, True])
def test_two_events_at_the_same_time_are_both_there(terminal):
    events = {"a": Event(half, terminal=terminal), "b": Event(three_halves, terminal=terminal), "c": Event(half)}
    run = simulate(DISK, [0.0, END], START, events=events)
    assert [int(found.count) for found in run.events.values()] == [1, 1, 1]
    np.testing.assert_allclose([found.times[0] for found in run.events.values()], 1.5, rtol=0, atol=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("start", [0.0, 0.1 + 0.2, 1e3 / 3])
def test_the_start_is_no_crossing(start):
    """Not even where rounding puts it on the other side, as of 0.1 + 0.2 beside 0.3."""
    events = {"here": Event(level(0.3 if start == 0.1 + 0.2 else start)), "on": Event(level(start + 1.0))}
    run = simulate(DISK, [0.0, END], DiskState(z=start, phidot=-1.0), events=events)
    assert (run.events["here"].count, run.events["on"].count) == (0, 1)


@pytest.mark.thorough
def test_a_number_has_a_name_and_a_level():
    events = {"z": Event("z", level=0.75), "height": Event("geometric_centre[0]", level=0.75)}
    run = simulate(DISK, [0.0, END], START, events=events)
    for found in run.events.values():
        np.testing.assert_allclose(found.times[0], 0.75, rtol=0, atol=1e-14)


def with_observables(disk, t, state, observables):
    return observables.kinetic_energy - 0.5 * t


@pytest.mark.thorough
def test_a_function_may_take_the_observables():
    """T = ½ (d + m r²) φ̇² = 3/4, which t/2 reaches at t = 3/2."""
    run = simulate(DISK, [0.0, END], START, events={"energy": Event(with_observables)})
    np.testing.assert_allclose(run.events["energy"].times[0], 1.5, rtol=0, atol=1e-13)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("normal_forc", "normal_force"),
        ("friction", "friction"),
        ("friction[2]", "friction"),
        ("z[0]", "z"),
    ],
)
def test_the_name_of_no_number(name, named):
    with refuses(ValueError, named):
        simulate(DISK, [0.0, END], START, events={"a": Event(name)})


SPEEDS = np.linspace(0.5, 1.5, 12)


@pytest.mark.long
@pytest.mark.parametrize("by", ["ensemble", "vmap"])
def test_lanes_of_many_runs(by):
    """z = v t up to t = 2: ⌊80 v / π⌋ waves, and z = 1.5 where v > 3/4."""
    events = {"waves": Event(waves), "half": Event(half, terminal=True)}
    starts = jax.vmap(lambda v: DiskState(phidot=-v))(jnp.asarray(SPEEDS))
    if by == "ensemble":
        found = simulate_ensemble(DISK, [0.0, END], starts, events=events, in_axes=(None, 0)).trajectory
    else:
        found = jax.jit(jax.vmap(lambda start: simulate(DISK, [0.0, END], start, events=events)))(starts)
    ends = SPEEDS * END > 1.5
    np.testing.assert_array_equal(found.events["half"].count, ends)
    np.testing.assert_array_equal(found.status, np.where(ends, Status.EVENT, Status.SUCCESS))
    reached = np.minimum(SPEEDS * END, 1.5)
    np.testing.assert_array_equal(found.events["waves"].count, np.floor(40 * reached / np.pi))
    np.testing.assert_allclose(found.events["half"].times[ends, 0], 1.5 / SPEEDS[ends], rtol=1e-13)
    assert np.all(np.isnan(found.events["half"].times[~ends]))


@pytest.mark.long
@pytest.mark.parametrize("mode", ["reverse", "forward"])
def test_derivatives_of_rows_of_which_half_have_no_event(mode):
    """t = ℓ/v for the level ℓ; where z does not reach it, the time and its derivatives are NaN, and nowhere else."""

    def time(v, place, adjoint):
        events = {"there": Event("z", level=place)}
        run = simulate(DISK, [0.0, END], DiskState(phidot=-v), events=events, adjoint=adjoint)
        return run.events["there"].times[0]

    speeds = jnp.linspace(0.5, 1.5, 64)
    if mode == "reverse":
        rates = jax.vmap(jax.grad(lambda v, place: time(v, place, None), argnums=(0, 1)), in_axes=(0, None))
    else:
        forward = diffrax.ForwardMode()
        rates = jax.vmap(jax.jacfwd(lambda v, place: time(v, place, forward), argnums=(0, 1)), in_axes=(0, None))
    by_speed, by_level = jaxball.jit(rates)(speeds, 2.0)
    there = speeds * END > 2.0
    assert 0 < np.sum(there) < 64
    np.testing.assert_allclose(by_speed[there], -2.0 / speeds[there] ** 2, rtol=1e-12)
    np.testing.assert_allclose(by_level[there], 1.0 / speeds[there], rtol=1e-12)
    assert np.all(np.isnan(by_speed[~there]))
