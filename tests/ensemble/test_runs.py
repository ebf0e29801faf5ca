"""Many runs are single runs, each of them, whatever their neighbours do."""

import itertools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import (
    BallState,
    Detachment,
    Disk,
    DiskState,
    Event,
    Fixed,
    FunctionForce,
    PointMass,
    Status,
    paper,
    simulate,
)
from jaxball.physics.classical import FreeRigidBody
from jaxball.programs.native import current_choice
from jaxball.simulation.ensemble import Maximum, simulate_ensemble
from jaxball.simulation.solvers import NDF, Adams, Gauss, RadauIIA
from tests.support.sentences import refuses, said

RUNS = 40
TIMES = np.linspace(0.0, 5.0, 6)
# Those of several tests, so that they share a program.
SMALL = {"lanes": 4, "chunk": 6, "max_steps": 200}


def stacked(items):
    """Items of the same structure with a leading axis."""
    return jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *items)


def disks(masses):
    """Disks that rock on an eccentric mass, at rest at the start and turned by a radian."""
    one = [Disk(mass=m, inertia=1.0, masses=[PointMass(1.0, Fixed((0.0, 0.0, -0.5)))]) for m in masses]
    return stacked(one), stacked([DiskState(phi=1.0) for _ in masses])


def single(system, state, k, times=TIMES, **settings):
    """A run of the ensemble on its own."""
    one = jax.tree.map(lambda leaf: jnp.asarray(leaf[k]), (system, state))
    return simulate(one[0], times, one[1], **settings)


def assert_same(found, k, wanted, bound):
    """Whether run k is ``wanted``, step by step."""
    one = jax.tree.map(lambda leaf: leaf[k], found.trajectory)
    assert int(one.status) == int(wanted.status)
    # An error that is its tolerance to the last bits may be kept here and rejected there.
    assert abs(int(one.steps) - int(wanted.steps)) <= 1
    assert abs(int(one.rejected) - int(wanted.rejected)) <= 1
    for a, b in zip(jax.tree.leaves(one.state), jax.tree.leaves(wanted.state), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=bound)


@pytest.fixture(scope="module")
def balls():
    """The paper's ball, which all runs share, from other attitudes."""
    rng = np.random.default_rng(1)
    q = np.array([1.0, 0, 0, 0]) + 0.01 * rng.normal(size=(RUNS, 4))
    states = [BallState(q=x / np.linalg.norm(x)) for x in q]
    return paper.ball(), stacked(states)


@pytest.mark.slow
def test_the_papers_ball(balls):
    ball, state = balls
    found = simulate_ensemble(ball, TIMES, state, lanes=16, in_axes=(None, 0))
    assert found.trajectory.state.q.shape == (RUNS, TIMES.size, 4)
    for k in (0, 17, RUNS - 1):
        assert_same(found, k, simulate(ball, TIMES, jax.tree.map(lambda leaf, k=k: jnp.asarray(leaf[k]), state)), 1e-11)


@pytest.mark.long
def test_each_run_has_a_level_of_its_own():
    """A disk that rolls freely is at z = t."""
    levels = np.array([0.5, 2.0, 7.0])
    events = {
        "own": jax.vmap(lambda level: Event("z", level=level, terminal=True))(jnp.asarray(levels)),
        "shared": Event("z", level=0.25),
    }
    found = simulate_ensemble(
        Disk(mass=1.0, inertia=0.5),
        np.tile(TIMES, (3, 1)),
        DiskState(phidot=-1.0),
        events=events,
        in_axes=(None, None, {"own": 0, "shared": None}),
        **SMALL,
    )
    own, shared = found.trajectory.events["own"], found.trajectory.events["shared"]
    np.testing.assert_array_equal(own.count, [1, 1, 0])
    np.testing.assert_allclose(own.times[:, 0], [0.5, 2.0, np.nan], rtol=1e-12)
    np.testing.assert_allclose(shared.times[:, 0], 0.25, rtol=1e-12)
    np.testing.assert_array_equal(found.status, [Status.EVENT, Status.EVENT, Status.SUCCESS])
    assert found.ok.tolist() == [True, True, True]


@pytest.mark.long
def test_an_ensemble_is_read_as_a_trajectory_is():
    system, state = disks([1.0, -1.0, 2.0])
    found = simulate_ensemble(system, TIMES, state, **SMALL)
    for name in ("system", "times", "state", "reached", "status", "steps", "rejected", "start", "contact"):
        assert getattr(found, name) is getattr(found.trajectory, name)
    assert found.ok.tolist() == [True, False, True]
    runs = list(found)
    assert len(runs) == len(found) == 3
    assert [run.ok for run in runs] == found.ok.tolist()
    one = single(system, state, 2)
    np.testing.assert_allclose(runs[2].state.phi, one.state.phi, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[-1].observables.energy, one.observables.energy, rtol=0, atol=1e-9)
    said(runs[1].message, "mass")


def pushed_from(t, start):
    return jnp.where(t < start, 0.0, 1.0) * jnp.array([3.0, 0.0, 0.0])


@pytest.mark.thorough
def test_where_a_force_jumps_the_slope_is_computed_anew():
    """A disk pushed from a time of its own: phi'' = -F r / (d + M r^2) since then."""
    starts = np.linspace(1.0, 4.0, 5)
    jumping = [Disk(mass=1.0, inertia=1.0, force=FunctionForce(pushed_from, t, kink_times=[t])) for t in starts]
    system, state = stacked(jumping), stacked([DiskState() for _ in starts])
    found = simulate_ensemble(system, TIMES, state, **SMALL)
    exact = -0.75 * np.maximum(TIMES - starts[:, None], 0.0) ** 2
    np.testing.assert_allclose(found.trajectory.state.phi, exact, rtol=0, atol=1e-12)
    assert not np.any(found.trajectory.rejected)
    for k in (0, 3):
        assert_same(found, k, single(system, state, k), 1e-12)


@pytest.mark.thorough
def test_what_runs_share_may_be_given_once():
    """Each program rounds, and so steps, in its own way: both are as exact as float64 can have them."""
    masses = np.linspace(0.5, 2.0, 12)
    system, state = disks(masses)
    exactly = {"rtol": 1e-14, "atol": 1e-14}
    whole = simulate_ensemble(system, TIMES, state, **exactly, **SMALL)
    axes = eqx.tree_at(lambda disk: disk.mass, jax.tree.map(lambda _: None, system), 0, is_leaf=lambda x: x is None)
    shared = _with_mass(jax.tree.map(lambda leaf: leaf[0], system), masses)
    found = simulate_ensemble(shared, TIMES, DiskState(phi=1.0), in_axes=(axes, None), **exactly, **SMALL)
    np.testing.assert_allclose(found.trajectory.state.phi, whole.trajectory.state.phi, rtol=0, atol=5e-12)
    for a, b in zip(jax.tree.leaves(found.trajectory), jax.tree.leaves(whole.trajectory), strict=True):
        assert a.shape == b.shape
    # A view of the one number, not a copy for each run.
    assert found.trajectory.system.radius.strides == (0,)


@pytest.mark.long
@pytest.mark.parametrize(
    "solver",
    [
        diffrax.Tsit5(),
        diffrax.Kvaerno5(),
        RadauIIA(stages=3),
        Gauss(stages=4),
        Adams(),
        NDF(),
    ],
    ids=lambda solver: type(solver).__name__,
)
def test_every_method_steps_as_in_a_run_of_its_own(solver):
    system, state = disks(np.linspace(0.5, 2.0, 5))
    found = simulate_ensemble(system, TIMES, state, solver=solver, rtol=1e-6, atol=1e-6)
    # Natively, runs whose steps make matrices are solved one by one, as single ones are.
    alone = current_choice() == "native" and isinstance(solver, RadauIIA)
    for k in (0, 3):
        # Where a method chooses its order, or when to stop iterating, rounding may decide; then within the tolerance.
        bound = 0.0 if alone else 1e-12 if isinstance(solver, diffrax.AbstractERK) else 1e-6
        assert_same(found, k, single(system, state, k, solver=solver, rtol=1e-6, atol=1e-6), bound)
    assert not alone or found.efficiency == 1


@pytest.mark.long
def test_runs_end_where_their_bodies_detach():
    """Wheels with an offset, of which the fast ones leave the plane."""
    wheels = stacked([Disk(mass=m, inertia=0.3, gravity=1.0, offset=(0.0, 0.0, -0.4)) for m in np.linspace(0.5, 2, 20)])
    start = stacked([DiskState(phidot=speed) for speed in np.linspace(0.5, 5.0, 20)])
    settings = {"events": {"lift": Detachment()}, "max_steps": 500}
    found = simulate_ensemble(wheels, TIMES, start, **settings)
    assert set(found.status.tolist()) == {Status.SUCCESS, Status.DETACHED}
    for k in (0, 19):
        one = single(wheels, start, k, **settings)
        assert_same(found, k, one, 1e-9)
        np.testing.assert_allclose(found.reached[k], one.reached, rtol=1e-9)
        assert int(found.trajectory.events["lift"].count[k]) == int(one.events["lift"].count)


@pytest.mark.thorough
def test_a_classical_system():
    system = stacked([FreeRigidBody(inertia=(1.0, 2.0, 2.5 + k / 10)) for k in range(3)])
    state = stacked([FreeRigidBody.state_type(Omega=(0.1, 1.0, 0.1))] * 3)
    found = simulate_ensemble(system, TIMES, state)
    # The first step's error is all rounding, and decides the length of the second; the solve itself is good to 6e-9.
    assert_same(found, 1, single(system, state, 1), 2e-9)


@pytest.mark.long
@pytest.mark.parametrize("compiler", ["xla", "native"])
def test_runs_that_are_computed_together_wait_for_the_longest(compiler):
    """Which costs little where they are sorted."""
    spans = np.sort(8.0 * 10 ** np.random.default_rng(0).uniform(0, 1, 400))
    system, state = disks(np.ones(spans.size))
    times = np.stack([np.zeros_like(spans), spans], axis=1)
    with jaxball.compiler(compiler):
        found = simulate_ensemble(system, times, state, lanes=8)
    steps = found.trajectory.steps
    assert steps.max() > 8 * steps.min()
    assert int(found.executed) == 8 * np.sum(np.max(np.asarray(steps).reshape(-1, 8), axis=1))
    assert found.efficiency > 0.85
    assert np.all(found.trajectory.reached == times[:, 1])
    assert_same(found, 200, single(system, state, 200, times=times[200]), 1e-11)


@pytest.mark.thorough
def test_a_run_that_fails_harms_no_other():
    masses = np.linspace(0.5, 2.0, 12)
    system, state = disks(masses)
    good = simulate_ensemble(system, TIMES, state, **SMALL)
    system, state = disks(masses)
    system.mass[3], state.phi[5] = -1.0, np.nan
    times = np.broadcast_to(TIMES, (12, TIMES.size)).copy()
    times[8] *= 1000
    found = simulate_ensemble(system, times, state, **SMALL)
    status = found.trajectory.status
    assert [status[3], status[5], status[8]] == [Status.IMPOSSIBLE, Status.IMPOSSIBLE, Status.MAX_STEPS]
    assert np.all(np.isnan(found.trajectory.state.phi[np.array([3, 5])]))
    assert np.isnan(found.trajectory.state.phi[8, -1])
    assert found.trajectory.reached[3] == 0
    assert 0 < found.trajectory.reached[8] < 5000
    others = np.array([k for k in range(12) if k not in (3, 5, 8)])
    np.testing.assert_array_equal(found.trajectory.state.phi[others], good.trajectory.state.phi[others])


@pytest.mark.thorough
def test_blocks_and_threads_change_nothing():
    system, state = disks(np.linspace(0.5, 2.0, 37))
    whole = simulate_ensemble(system, TIMES, state, lanes=8, threads=1)
    parts = simulate_ensemble(system, TIMES, state, **SMALL, threads=2)
    np.testing.assert_allclose(whole.trajectory.state.phi, parts.trajectory.state.phi, rtol=0, atol=1e-14)


@pytest.mark.long
def test_fewer_runs_than_a_block_compile_nothing_anew():
    traces = []

    def quantity(system, t, state):
        traces.append(t)
        return state.phidot**2

    fastest = {"fastest": Maximum(quantity)}
    system, state = disks(np.linspace(0.5, 2.0, 6))
    whole = simulate_ensemble(system, TIMES, state, reductions=fastest, **SMALL)
    count = len(traces)
    few = jax.tree.map(lambda leaf: leaf[:2], (system, state))
    found = simulate_ensemble(few[0], TIMES, few[1], reductions=fastest, **SMALL)
    assert len(traces) == count > 0
    np.testing.assert_array_equal(found.trajectory.state.phi, whole.trajectory.state.phi[:2])
    np.testing.assert_array_equal(found.reductions["fastest"], whole.reductions["fastest"][:2])


def _with_mass(system, m):
    return eqx.tree_at(lambda disk: disk.mass, system, m)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"solver": diffrax.Euler()}, "solver"),
        ({"dae": True, "solver": RadauIIA()}, "state"),
        ({"project": True}, "project"),
        ({"adjoint": diffrax.DirectAdjoint()}, "adjoint"),
        ({"times": np.zeros((3, 2))}, "system"),
        ({"in_axes": (None, None)}, "system"),
        ({"in_axes": 1}, "in_axes"),
        ({"in_axes": (0, 0, 1)}, "in_axes"),
        ({"in_axes": (0, 0, 0, 0)}, "in_axes"),
    ],
)
def test_wrong_arguments_are_named(change, named, no_type_checks):
    system, state = disks(np.ones(2))
    with refuses((TypeError, ValueError), named):
        simulate_ensemble(**{"system": system, "times": TIMES, "state": state} | change)


def test_a_loop_over_an_ensemble_ends_after_its_last_run():
    """JAX takes the last entry for an index that is too large, by which a loop would never end."""
    systems, states = disks([1.0, 2.0, 3.0])
    ensemble = simulate_ensemble(systems, TIMES, states, **SMALL)
    assert len(list(itertools.islice(ensemble, 5))) == 3
    for index in (3, 99, -4):
        with refuses(IndexError, "The number of a run"):
            ensemble[index]
    np.testing.assert_array_equal(ensemble[-1].system.mass, 3.0)
    np.testing.assert_array_equal(ensemble[np.int64(2)].system.mass, 3.0)


def test_no_runs_are_refused_in_a_sentence():
    systems, states = disks([1.0])
    none = jax.tree.map(lambda leaf: leaf[:0], states)
    with refuses(ValueError, "system"):
        simulate_ensemble(jax.tree.map(lambda leaf: leaf[0], systems), TIMES, none, in_axes=(None, 0))


def test_an_ensemble_without_states_starts_at_rest():
    """As a single run does without one; and what an ensemble lacks is said to be that of a run."""
    systems, _ = disks([1.0, 2.0])
    without = simulate_ensemble(systems, TIMES, **SMALL)
    rest = stacked([DiskState(), DiskState()])
    given = simulate_ensemble(systems, TIMES, rest, **SMALL)
    np.testing.assert_array_equal(without.state.z, given.state.z)
    np.testing.assert_array_equal(without.friction_needed, jnp.max(without.observables.friction_ratio, axis=1))
    assert without.events == {}
    one = simulate_ensemble(jax.tree.map(lambda leaf: leaf[0], systems), TIMES, rest, in_axes=(None, 0), **SMALL)
    assert one.state.z.shape == (2, 6)
    with refuses(AttributeError, "plot"):
        without.plot()
    with refuses(AttributeError, "stats"):
        without.stats  # noqa: B018
