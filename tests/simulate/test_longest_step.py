"""``max_step`` limits every step, by every way to a solve, and finds what no sampling does."""

import dataclasses
import tomllib

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Disk, DiskState, FunctionForce, Scenario, Status, simulate
from jaxball.simulation.ensemble import simulate_ensemble
from jaxball.simulation.solvers import NDF, Adams, RadauIIA

LONGEST = 0.15
DISK = Disk(mass=1.0, inertia=0.5)
ROLLING = DiskState(phidot=-1.0)
# The steps of a disk that rolls at a constant speed are limited by nothing else.
FEWEST = int(np.ceil(2.0 / LONGEST))


def step_lengths(run):
    """The lengths of the steps of a run with dense output."""
    times = np.asarray(run.interpolant.solution.interpolation.ts)
    return np.diff(times[np.isfinite(times)])


@pytest.mark.thorough
@pytest.mark.parametrize(
    "solver", [diffrax.Dopri8(), RadauIIA(stages=3), Adams(), NDF()], ids=lambda s: type(s).__name__
)
def test_no_step_is_longer(solver):
    run = simulate(DISK, [0.0, 2.0], ROLLING, solver=solver, max_step=LONGEST, dense=True)
    lengths = step_lengths(run)
    assert run.ok
    np.testing.assert_allclose(np.sum(lengths), 2.0, rtol=1e-14)
    # A step that would end within 100 roundings of the end of the run ends there.
    assert np.max(lengths) <= LONGEST * (1 + 1e-13)
    assert len(lengths) >= FEWEST


@pytest.mark.thorough
def test_no_step_is_longer_where_modes_and_kinks_end_steps():
    # A disk of inertia m r²/2 that is thrown without spin slips for v/(3 μ g) = 1. Kinks are at 1.4 and 1.7.
    push = jaxball.control.Push((0.05, 0.0, 0.0), start=1.4, duration=0.3)
    disk = Disk(mass=1.0, inertia=0.5, gravity=1.0, force=push)
    state = jaxball.physics.ReleasedState(DiskState(), V=(0.3, 0.0, 0.0))
    run = simulate(disk, [0.0, 2.0], state, contact=jaxball.Contact(friction=0.1), max_step=LONGEST, dense=True)
    assert run.ok
    assert run.contact is not None
    assert run.contact.switches.count == 1
    # The step after an event begins where that was, which is within the search's accuracy before the end of the last.
    assert np.max(step_lengths(run)) <= LONGEST * (1 + 1e-6)


def pushes(t, width):
    return jnp.array([1.0, 0.0, 0.0]) * sum(jnp.exp(-(((t - centre) / width) ** 2)) for centre in (2.031, 8.017))


@pytest.mark.thorough
def test_pushes_below_any_sampling_are_seen():
    # Two of them, 1e-5 of the run wide: not seen by samples, and by steps of three widths.
    width = 1e-4
    disk = Disk(mass=1.0, inertia=0.5, force=FunctionForce(pushes, jnp.asarray(width)))
    run = simulate(disk, [0.0, 10.0], rtol=1e-8, atol=1e-8, max_step=3 * width, max_steps=2**17)
    assert run.status == Status.SUCCESS
    np.testing.assert_allclose(-run.state.phidot[-1], 2 * width * np.sqrt(np.pi) / 1.5, atol=1e-7)


@pytest.mark.thorough
def test_ensembles_scenarios_and_files_pass_it_on():
    disks = jax.vmap(lambda mass: Disk(mass=mass, inertia=0.5))(jnp.array([1.0, 2.0]))
    ensemble = simulate_ensemble(disks, [0.0, 2.0], ROLLING, in_axes=(0, None), max_step=LONGEST)
    assert np.all(np.asarray(ensemble.trajectory.steps) >= FEWEST)
    scenario = Scenario("rolling", DISK, ROLLING, np.array([0.0, 2.0]), max_step=LONGEST)
    text = jaxball.write_scenario(scenario)
    assert tomllib.loads(text)["solve"]["max_step"] == LONGEST
    assert jaxball.read_scenario(text).max_step == LONGEST
    assert scenario.simulate().steps >= FEWEST
    assert scenario.simulate(max_step=0.05).steps >= 40
    free = dataclasses.replace(scenario, max_step=None)
    assert free.simulate().steps < FEWEST
    assert "max_step " not in jaxball.write_scenario(free)
