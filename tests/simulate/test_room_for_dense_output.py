"""Dense output has room for few steps at first, and for as many as are needed in the end."""

import diffrax
import numpy as np
import pytest

from jaxball import Status, simulate
from jaxball.physics.classical import FreeRigidBody, RigidBodyState

TIMES = np.linspace(0.0, 60.0, 7)
BODY, START = FreeRigidBody(inertia=(1.0, 2.0, 3.0)), RigidBodyState(Omega=(0.4, 0.1, 1.5))


@pytest.fixture(scope="module")
def run():
    return simulate(BODY, TIMES, START, dense=True, solver=diffrax.Tsit5(), rtol=1e-9, atol=1e-9)


@pytest.mark.thorough
def test_a_run_of_more_steps_than_the_first_room(run):
    assert run.steps > 256
    assert run.status == Status.SUCCESS
    np.testing.assert_allclose(run.at(TIMES).Omega, run.state.Omega, rtol=0, atol=1e-12)
    assert run.interpolant.solution.interpolation.ts.shape == (2049,)


def test_max_steps_is_still_the_limit(run):
    few = simulate(BODY, TIMES, START, dense=True, solver=diffrax.Tsit5(), rtol=1e-9, atol=1e-9, max_steps=300)
    assert (few.status == Status.MAX_STEPS) == (run.steps > 300)
    assert few.steps == min(int(run.steps), 300)
