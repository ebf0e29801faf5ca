"""Designs with mechanisms: torques that are given, and friction that is found from a path."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.studies import design
from jaxball.studies.design import DesignSpace, Variable
from jaxball.studies.design.problem.run import Run
from tests.design.documents import builtin

TIMES = np.linspace(0.0, 1.0, 21)
TORQUE, FORCE, RADIUS, GRAVITY = 0.3, 0.2, 2.0, 3.0


def run_with_motors():
    """A motor on a hinge with the torque 0.3 sin t, and one on a slider with the force 0.2."""
    swing = jaxball.planar_pendulum(0.5, 0.6, drive=jaxball.Motor(jaxball.Sinusoids(0.0, [TORQUE], [1.0])))
    slide = jaxball.physics.mass_in_tube(0.5, (0.0, 0.0, 1.0), drive=jaxball.Motor(FORCE))
    disk = jaxball.Disk(mass=1.0, inertia=2.0, radius=RADIUS, gravity=GRAVITY, mechanisms=[swing, slide])
    state = jaxball.DiskState(theta=[0.2, 0.0], thetadot=[0.0, 0.0])
    run = jaxball.simulate(disk, TIMES, state).raise_if_failed()
    return Run(disk, jnp.asarray(TIMES), run.state, run.status)


@pytest.mark.slow
def test_efforts_of_joints_are_those_of_their_motors():
    run, weight = run_with_motors(), 2.0 * GRAVITY
    by_accelerations = jax.jit(lambda run: run.observables.joint_efforts)(run)  # Σ m χ_a·(a + γ)
    np.testing.assert_allclose(run.joint_efforts, by_accelerations, atol=1e-12)
    squares = (TORQUE * np.sin(TIMES) / (weight * RADIUS)) ** 2 + (FORCE / weight) ** 2
    expected = np.mean((squares[1:] + squares[:-1]) / 2)
    np.testing.assert_allclose(float(design.JointEffort()(run)), expected, rtol=1e-9)
    violation = design.JointEffortLimit(0.25)(run)
    largest = TORQUE * np.max(np.sin(TIMES))
    expected = [(largest - 0.25) / (weight * RADIUS), (FORCE - 0.25) / weight]
    np.testing.assert_allclose(jnp.max(violation, axis=0), expected, rtol=1e-8)


@pytest.mark.slow
def test_friction_is_found_from_a_path():
    """A ball with a pendulum, from rest on a slope, whose path has noise of a thousandth of the radius."""
    document = builtin("pendulum-on-a-slope", start=0.0, end=8.0, saves=161)
    names = ("resistance.rolling", "resistance.dry", "mechanisms[0].joints[0].force[1].coefficient")
    truth = DesignSpace(document, [Variable((name,)) for name in names])
    path = np.asarray(truth.scenario.simulate().state.z)
    starts = (0.15, 0.03, 0.07)
    space = DesignSpace(document, [Variable((name,), start=x) for name, x in zip(names, starts, strict=True)])
    result = space.identify(path + 1e-3 * np.random.default_rng(5).normal(size=path.shape))
    assert result.ok
    low, high = result.intervals(0.999).T
    exact = np.asarray([0.2, 0.02, 0.05])
    assert np.all((low < exact) & (exact < high)), str(result)
    assert np.all(result.deviations < 0.02), str(result)
