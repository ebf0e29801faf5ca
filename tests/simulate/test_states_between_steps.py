"""States within steps are as exact as those at their ends: saved ones, and those of events, extremes and ensembles."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import jaxball
from jaxball import Disk, DiskState, Event, Fixed, PointMass, contact_extremes, load_scenario, simulate
from jaxball.physics.classical import FreeRigidBody, RigidBodyState
from jaxball.simulation.ensemble import Integral, Maximum, Minimum, simulate_ensemble
from tests.support.paper import paper_ball, paper_disk, reference

SECONDS = np.linspace(0.0, 20.0, 21)
TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)
FACTOR = 10  # between errors within steps and those at their ends

SHAKEN = """
format = 1
title = "A pendulum in a ball on a plane that is shaken"
kind = "ball"
[body]
mass = 1.0
radius = 1.0
inertia = [0.4, 0.4, 0.4]
gravity = 9.8
[[mechanisms]]
[[mechanisms.joints]]
kind = "hinge"
axis = [0.0, 1.0, 0.0]
[[mechanisms.joints]]
kind = "hinge"
axis = [1.0, 0.0, 0.0]
[[mechanisms.masses]]
mass = 0.8
place = [0.0, 0.0, -0.5]
[ground.motion.free]
constant = [0.0, 0.0, 0.0]
amplitude = [[0.05, 0.0, 0.02]]
frequency = [9.0]
[initial]
axis = [1.0, 0.0, 0.0]
angle = 0.2
theta = [0.5, 0.3]
thetadot = [0.7, 0.0]
[time]
start = 0.0
end = 4.0
step = 1.0
"""

EIGHTH, FIFTHS = diffrax.Dopri8(), (diffrax.Dopri5(), diffrax.Tsit5())
SLOW = {"marks": pytest.mark.slow}


def names(solvers):
    return [type(solver).__name__ for solver in solvers]


def largest(states, exact):
    """The largest error of any number of states, at all times but the first and the last."""
    pairs = zip(jax.tree.leaves(states), jax.tree.leaves(exact), strict=True)
    return max(float(np.max(np.abs(np.asarray(a) - np.asarray(b))[1:-1])) for a, b in pairs if np.size(a))


def assert_as_exact_as_steps(system, times, state, exact, of_state, solver, tolerances=TOLERANCES):
    """Compares runs that save on their way with runs whose steps end at the same times."""
    for tolerance in tolerances:
        settings = {"rtol": tolerance, "atol": tolerance, "solver": solver, "throw": True}
        within, at_ends = (
            largest(of_state(simulate(system, times, state, step_to_times=there, **settings).state), exact)
            for there in (False, True)
        )
        assert within < FACTOR * max(at_ends, 0.1 * tolerance)


@pytest.mark.long
@pytest.mark.parametrize("solver", [EIGHTH, FIFTHS[1]], ids=names([EIGHTH, FIFTHS[1]]))
def test_the_papers_disk(solver):
    """Beside the 30 digits of its reference; diffrax's interpolation was off by 90 tolerances at 1e-12."""
    exact, columns = reference("paper_disk")
    exact = exact[:, [columns.index("phi"), columns.index("phidot")]]
    of_state = lambda state: np.stack([state.phi, state.phidot], axis=1)  # noqa: E731
    assert_as_exact_as_steps(paper_disk(), SECONDS, DiskState(), exact, of_state, solver)


@pytest.mark.slow
@pytest.mark.parametrize("solver", [EIGHTH, *FIFTHS], ids=names([EIGHTH, *FIFTHS]))
def test_the_papers_ball(solver):
    exact = simulate(paper_ball(), SECONDS, step_to_times=True, rtol=1e-14, atol=1e-14).state
    assert_as_exact_as_steps(paper_ball(), SECONDS, None, exact, lambda state: state, solver)


@pytest.mark.long
@pytest.mark.parametrize("solver", [EIGHTH, *(pytest.param(s, **SLOW) for s in FIFTHS)], ids=names([EIGHTH, *FIFTHS]))
def test_a_mechanism_on_a_vibrating_plane(solver, tmp_path):
    path = tmp_path / "shaken.toml"
    path.write_text(SHAKEN)
    scenario, times = load_scenario(path), np.linspace(0.0, 4.0, 14)
    settings = {"step_to_times": True, "rtol": 1e-14, "atol": 1e-14, "max_steps": 100_000}
    exact = simulate(scenario.system, times, scenario.state, **settings).state
    assert_as_exact_as_steps(scenario.system, times, scenario.state, exact, lambda state: state, solver)


# The free body of Landau & Lifshitz § 37: Ω = (A cn, −B sn, C dn)(bt | m).
INERTIA, OMEGA = np.array([1.0, 2.0, 3.0]), np.array([0.4, 0.0, 1.5])
MOMENTUM, ENERGY = INERTIA**2 @ OMEGA**2, INERTIA @ OMEGA**2
RATE = np.sqrt((INERTIA[2] - INERTIA[1]) * (MOMENTUM - ENERGY * INERTIA[0]) / np.prod(INERTIA))
PARAMETER = (INERTIA[1] - INERTIA[0]) * (ENERGY * INERTIA[2] - MOMENTUM)
PARAMETER /= (INERTIA[2] - INERTIA[1]) * (MOMENTUM - ENERGY * INERTIA[0])


def second(system, t, state):
    """Ω2."""
    return state.Omega[1]


@pytest.mark.thorough
def test_events_and_dense_output_of_a_body_with_a_closed_form():
    times = np.linspace(0.0, 12.0, 3)
    fine = np.linspace(0.0, 12.0, 101)
    _, cn, dn, _ = ellipj(RATE * fine, PARAMETER)
    zeros = 2 * ellipk(PARAMETER) / RATE * np.arange(1, 5)
    for tolerance in (1e-8, 1e-10, 1e-12):
        run = simulate(
            FreeRigidBody(inertia=INERTIA),
            times,
            RigidBodyState(Omega=OMEGA),
            rtol=tolerance,
            atol=tolerance,
            events={"zero": Event(second)},
            dense=True,
        )
        np.testing.assert_allclose(run.at(fine).Omega[:, 0], 0.4 * cn, rtol=0, atol=FACTOR * tolerance)
        np.testing.assert_allclose(run.at(fine).Omega[:, 2], 1.5 * dn, rtol=0, atol=FACTOR * tolerance)
        np.testing.assert_allclose(run.events["zero"].times[:4], zeros, rtol=0, atol=FACTOR * tolerance)


def angle(system, t, state):
    """φ."""
    return state.phi


def squared(system, t, state):
    """φ̇²."""
    return state.phidot**2


REDUCTIONS = {"high": Maximum(angle), "low": Minimum(angle), "action": Integral(squared)}


@pytest.mark.thorough
def test_ensembles_save_and_reduce_as_exactly():
    """Two of the paper's disks, one of them turned a little, beside the reference."""
    exact, columns = reference("paper_disk")
    state = jax.vmap(lambda phi: DiskState(phi=phi))(jnp.array([0.0, 0.01]))
    found = {
        tolerance: simulate_ensemble(
            paper_disk(), SECONDS, state, in_axes=(None, 0), rtol=tolerance, atol=tolerance, reductions=REDUCTIONS
        )
        for tolerance in (1e-12, 1e-14)
    }
    run = found[1e-12].trajectory.state
    np.testing.assert_allclose(run.phi[0], exact[:, columns.index("phi")], rtol=0, atol=FACTOR * 1e-12)
    np.testing.assert_allclose(run.phidot[0], exact[:, columns.index("phidot")], rtol=0, atol=FACTOR * 1e-12)
    for name in ("high", "low", "action"):
        loose, tight = (found[tolerance].reductions[name] for tolerance in found)
        np.testing.assert_allclose(loose, tight, rtol=FACTOR * 1e-12, atol=FACTOR * 1e-12)


ROCKING = DiskState(phi=1.0)


def rocking(mass):
    return Disk(mass=mass, inertia=1.0, masses=[PointMass(1.0, Fixed((0.0, 0.0, -0.5)))])


@pytest.mark.thorough
def test_extremes_of_the_contact_force():
    """A disk that rocks from rest exerts the least force at rest, φ = ±1, or in between; energy says how fast it is."""
    found = [
        contact_extremes(simulate(rocking(1.3), [0.0, 11.3], ROCKING, rtol=tolerance, atol=tolerance, dense=True))
        for tolerance in (1e-10, 1e-14)
    ]
    for name in ("least_normal_force", "largest_friction", "friction_needed"):
        loose, tight = (float(getattr(one, name)) for one in found)
        assert abs(loose - tight) < FACTOR * 1e-10 * abs(tight)


def saved_angle(mass, t, adjoint, step_to_times=False):
    """φ at ``t``, which lies within a step unless steps end there."""
    times = jnp.stack([jnp.zeros_like(t), t, jnp.full_like(t, 4.0)])
    return simulate(
        rocking(mass), times, ROCKING, rtol=1e-11, atol=1e-11, adjoint=adjoint, step_to_times=step_to_times
    ).state.phi[1]


MASS, BETWEEN = jnp.asarray(1.3), jnp.asarray(2.345)


@functools.cache
def forward_derivatives(step_to_times):
    """Those of the saved angle, with respect to a mass and to the time."""
    derivatives = jax.jacfwd(saved_angle, (0, 1))
    return jaxball.jit(lambda mass, t: derivatives(mass, t, diffrax.ForwardMode(), step_to_times))(MASS, BETWEEN)


@pytest.mark.thorough
def test_forward_derivatives_of_states_between_steps():
    """Those of runs that step to that time; with respect to the time it is the rate."""
    (of_mass, of_time), (there, _) = forward_derivatives(False), forward_derivatives(True)
    np.testing.assert_allclose(of_mass, there, rtol=0, atol=2e-10)
    rate = simulate(rocking(MASS), [0.0, BETWEEN], ROCKING, rtol=1e-12, atol=1e-12).state.phidot[-1]
    np.testing.assert_allclose(of_time, rate, rtol=0, atol=2e-10)


@pytest.mark.long
def test_reverse_derivatives_of_states_between_steps():
    adjoint = diffrax.RecursiveCheckpointAdjoint()
    found = jaxball.jit(jax.grad(lambda mass, t: saved_angle(mass, t, adjoint), (0, 1)))(MASS, BETWEEN)
    np.testing.assert_allclose(found, forward_derivatives(False), rtol=0, atol=1e-11)  # some rounding of 100 steps


@pytest.mark.thorough
def test_a_run_of_which_nothing_is_saved_between_steps_evaluates_nothing_more():
    """Two times, or times at which steps end; and a time between costs the evaluations of its step."""
    count = []

    class Counted(FreeRigidBody):
        def field_of_packed(self, t, packed):
            jax.debug.callback(lambda: count.append(None))
            return super().field_of_packed(t, packed)

    def evaluations(times, step_to_times=False):
        run = simulate(
            Counted(inertia=INERTIA),
            times,
            RigidBodyState(Omega=OMEGA),
            adjoint=diffrax.ForwardMode(),
            step_to_times=step_to_times,
        )
        jax.block_until_ready(run.state)
        jax.effects_barrier()
        evaluated = len(count)
        count.clear()
        return evaluated, int(run.steps)

    two, many = evaluations([0.0, 3.0]), evaluations([0.0, 1.1, 2.2, 3.0], step_to_times=True)
    saved = evaluations([0.0, 1.1, 1.1000001, 2.2, 3.0])
    assert two[0] == 13 * two[1] + 1
    assert many[0] == 13 * many[1] + 1
    assert saved == (two[0] + 2 * 7, two[1])
