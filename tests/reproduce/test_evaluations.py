"""The counter of evaluations against counts made by hand from the solvers' tableaux."""

import diffrax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest

import jaxball
from jaxball.paper.reproduce.experiments import Counter, CountingSolver
from jaxball.simulation.solvers import MassMatrixTerm, RadauIIA, SimplifiedNewton

STEPS = 10


def decay(t, y, args):
    return -y


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("solver", "count"),
    [
        (diffrax.Heun(), 2 * STEPS),
        (diffrax.Dopri5(), 1 + 6 * STEPS),  # seven stages, of which the first is the last one's again
    ],
)
def test_fixed_steps(solver, count):
    counter = Counter()
    diffrax.diffeqsolve(
        diffrax.ODETerm(decay), CountingSolver(solver, counter), 0.0, 1.0, 1.0 / STEPS, jnp.asarray(1.0)
    )
    assert counter.read() == count


def at_rest(t, y, args):
    """ẋ₀ = 0 and, with the mass matrix below, x₁ = x₀."""
    return jnp.stack([jnp.zeros_like(y[0]), y[0] - y[1]])


@pytest.mark.long
@pytest.mark.parametrize(("stages", "mass"), [(3, None), (5, (1.0, 0.0))], ids=["ODE", "DAE"])
def test_stages_and_jacobians(stages, mass):
    """Where nothing moves, a step is a Jacobian and one pass over its stages; a DAE's start is checked by one more."""
    term = diffrax.ODETerm(at_rest) if mass is None else MassMatrixTerm(at_rest, jnp.asarray(mass))
    root_finder = SimplifiedNewton(rtol=1e-8, atol=1e-8, norm=optimistix.max_norm)
    counter = Counter()
    solver = CountingSolver(RadauIIA(stages=stages, root_finder=root_finder), counter)
    for start, end in ((0.0, 1.0), (1.0, 0.0)):
        before = counter.read()
        times = map(jnp.asarray, (start, end, (end - start) / STEPS))
        solution = diffrax.diffeqsolve(term, solver, *times, jnp.array([2.0, 2.0]))
        np.testing.assert_array_equal(solution.ys, [[2.0, 2.0]])
        assert counter.read() - before == (stages + 1) * STEPS + (mass is not None)


@pytest.fixture(scope="module")
def rocking_ball():
    """A ball without kinks: one mass held off the axis."""
    return jaxball.Ball(
        mass=1.0,
        inertia=(0.9, 1.0, 1.1),
        masses=[jaxball.PointMass(0.5, jaxball.Fixed((0.3, 0.2, -0.4)))],
    )


@pytest.mark.thorough
def test_adaptive_steps_of_a_ball(rocking_ball):
    """Accepted or rejected, every step after the first keeps its first stage."""
    counter = Counter()
    counted = jaxball.simulate(
        rocking_ball, np.array([0.0, 5.0]), solver=CountingSolver(diffrax.Dopri5(), counter), throw=True
    )
    assert counted.steps > 5
    assert counter.read() == 1 + 6 * int(counted.steps)


@pytest.mark.long
def test_counting_changes_no_result():
    """An implicit method's, with the step-size control's tolerances handed on to the root finder."""

    def solve(solver):
        control = diffrax.PIDController(rtol=1e-6, atol=1e-6)
        term = diffrax.ODETerm(decay)
        return diffrax.diffeqsolve(term, solver, 0.0, 1.0, None, jnp.asarray(1.0), stepsize_controller=control)

    counter, solver = Counter(), diffrax.Kvaerno5()
    plain, counted = solve(solver), solve(CountingSolver(solver, counter))
    assert counted.stats["num_steps"] == plain.stats["num_steps"]
    np.testing.assert_allclose(counted.ys, plain.ys, rtol=1e-14)
    assert counter.read() >= 6 * counted.stats["num_steps"]  # an implicit stage takes one evaluation or more
