"""The counter of evaluations against counts made by hand from the solvers' tableaux."""

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.paper.reproduce.evaluations import Counter, CountingSolver

STEPS = 10


def decay(t, y, args):
    return -y


@pytest.mark.parametrize(
    ("solver", "count"),
    [
        (diffrax.Euler(), STEPS),
        (diffrax.Heun(), 2 * STEPS),
        (diffrax.Dopri5(), 1 + 6 * STEPS),  # seven stages, of which the first is the last one's again
        (diffrax.Tsit5(), 1 + 6 * STEPS),
        (diffrax.Dopri8(), 1 + 13 * STEPS),
    ],
)
def test_fixed_steps(solver, count):
    counter = Counter()
    diffrax.diffeqsolve(
        diffrax.ODETerm(decay), CountingSolver(solver, counter), 0.0, 1.0, 1.0 / STEPS, jnp.asarray(1.0)
    )
    assert counter.read() == count


@pytest.fixture(scope="module")
def rocking_ball():
    """A ball without kinks: one mass held off the axis."""
    return jaxball.Ball(
        mass=1.0,
        inertia=(0.9, 1.0, 1.1),
        masses=[jaxball.PointMass(0.5, jaxball.Fixed((0.3, 0.2, -0.4)))],
    )


def test_adaptive_steps_of_a_ball(rocking_ball):
    """Accepted or rejected, every step after the first keeps its first stage."""
    counter = Counter()
    counted = jaxball.simulate(
        rocking_ball, np.array([0.0, 5.0]), solver=CountingSolver(diffrax.Dopri5(), counter), throw=True
    )
    assert counted.steps > 5
    assert counter.read() == 1 + 6 * int(counted.steps)


@pytest.mark.parametrize("solver", [diffrax.Tsit5(), diffrax.Kvaerno5()])
def test_counting_changes_no_result(solver):
    """Explicit or implicit, with the step-size control's tolerances handed on to the root finder."""

    def solve(solver):
        control = diffrax.PIDController(rtol=1e-6, atol=1e-6)
        term = diffrax.ODETerm(decay)
        return diffrax.diffeqsolve(term, solver, 0.0, 1.0, None, jnp.asarray(1.0), stepsize_controller=control)

    counter = Counter()
    plain, counted = solve(solver), solve(CountingSolver(solver, counter))
    assert counted.stats["num_steps"] == plain.stats["num_steps"]
    np.testing.assert_allclose(counted.ys, plain.ys, rtol=1e-14)
    assert counter.read() >= 6 * counted.stats["num_steps"]  # an implicit stage takes one evaluation or more
