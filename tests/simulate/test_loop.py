"""The loop of a solve takes the steps of diffrax's own loop and saves what that saves, and calls nothing in Python."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Status
from jaxball.physics.packing import Packing
from jaxball.simulation.loop import by_tolerances, kinks_of, to_kinks
from tests.support.paper import paper_ball
from tests.support.sentences import refuses, said

BALL = paper_ball()
TIMES = np.linspace(0.0, 3.0, 31)
DISK = jaxball.Disk(mass=1.0, inertia=0.5, offset=(0.1, 0.0, -0.2))


@pytest.mark.thorough
def test_the_steps_are_those_of_diffrax():
    run = jaxball.simulate(BALL, TIMES)
    packing, t = Packing.of(BALL.prepare(), jaxball.BallState()), jnp.asarray(TIMES)
    tolerance = jnp.asarray(1e-10)
    solution = jax.jit(
        lambda: diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, x, _: packing.field(jnp.asarray(t), x)),
            diffrax.Dopri8(),
            t[0],
            t[-1],
            None,
            packing.pack(t[0], jaxball.BallState()),
            saveat=diffrax.SaveAt(ts=t),
            stepsize_controller=to_kinks(by_tolerances(tolerance, tolerance), kinks_of(BALL)),
        )
    )()
    assert run.steps == solution.stats["num_steps"]
    assert run.rejected == solution.stats["num_rejected_steps"]
    states = jax.vmap(packing.unpack)(t, solution.ys)
    # Between steps diffrax interpolates with an error of 1e-8.
    for rows, bound in ((slice(None), 1e-8), (np.array([0, -1]), 2e-13)):
        jax.tree.map(
            lambda a, b, rows=rows, bound=bound: np.testing.assert_allclose(a[rows], b[rows], atol=bound),
            run.state,
            states,
        )


@pytest.mark.parametrize("times", [TIMES, TIMES[[0, -1]]], ids=["many", "two"])
def test_no_program_calls_back(times):
    program = jax.jit(lambda disk, times: jaxball.simulate(disk, times).state.z).lower(DISK, times)
    assert "callback" not in program.as_text()


def test_traced_times_that_do_not_increase():
    solve = jax.jit(lambda times: jaxball.simulate(DISK, times, jaxball.DiskState(phidot=1.0)))
    for times in (TIMES[::-1], np.zeros_like(TIMES), np.full_like(TIMES, np.nan)):
        run = solve(times)
        assert run.status == Status.IMPOSSIBLE
        said(run.message, "times")
        assert np.all(np.isnan(run.state.z))
    assert solve(TIMES).ok


def test_other_adjoints_are_refused():
    for adjoint in (diffrax.BacksolveAdjoint(), diffrax.ImplicitAdjoint()):
        named = "adjoint"
        with refuses(TypeError, named):
            jaxball.simulate(DISK, TIMES, adjoint=adjoint)
