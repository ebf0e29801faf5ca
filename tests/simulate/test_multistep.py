"""Runs of jaxball by the methods of variable order, against runs by others, and how often they evaluate f."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Ball, BallState, Contact, Event, PointMass, simulate
from jaxball.paper import reference
from jaxball.paper.reproduce.experiments import Counter, CountingSolver
from jaxball.physics import ReleasedState
from jaxball.physics.packing import Packing
from jaxball.simulation.loop import by_tolerances, kinks_of, to_kinks
from jaxball.simulation.solvers import NDF, Adams, Projected
from jaxball.simulation.solvers.base import approach_of
from tests.support.paper import paper_ball

ADAMS, DOPRI8 = Adams(), diffrax.Dopri8()
# With how their errors compare with those of Adams: that of NDF has order 5.
ERRORS = {ADAMS: 1.0, NDF(): 20.0}


@pytest.fixture(params=ERRORS, ids=lambda solver: type(solver).__name__)
def solver(request):
    return request.param


BALL = paper_ball()
TIMES = np.linspace(0.0, 3.0, 31)


def split(ball, parts):
    """The same ball with every mass made of ``parts`` equal ones in one place."""
    masses = [PointMass(item.mass / parts, item.motion) for item in ball.point_masses for _ in range(parts)]
    return Ball(mass=ball.mass, inertia=ball.inertia, radius=ball.radius, offset=ball.offset, masses=masses)


class TestOneRun:
    @staticmethod
    @functools.cache
    def run(solver):
        return simulate(BALL, TIMES, solver=solver, dense=True, throw=True)

    @pytest.mark.long
    def test_agrees_with_a_run_by_dopri8(self, solver):
        other = simulate(BALL, TIMES, rtol=1e-12, atol=1e-12, step_to_times=True, throw=True)
        bound = 5e-9 * ERRORS[solver]
        jax.tree.map(
            lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=bound), self.run(solver).state, other.state
        )

    @pytest.mark.long
    def test_the_steps_are_those_of_diffrax(self, solver):
        packing, t = Packing.of(BALL.prepare(), BallState()), jnp.asarray(TIMES)
        controller = by_tolerances(jnp.asarray(1e-10), jnp.asarray(1e-10), solver)
        solution = jax.jit(
            lambda: diffrax.diffeqsolve(
                diffrax.ODETerm(lambda t, x, _: packing.field(jnp.asarray(t), x)),
                solver,
                t[0],
                t[-1],
                None,
                packing.pack(t[0], BallState()),
                saveat=diffrax.SaveAt(ts=t),
                stepsize_controller=to_kinks(controller, kinks_of(BALL)),
            )
        )()
        assert self.run(solver).steps == solution.stats["num_steps"]
        assert self.run(solver).rejected == solution.stats["num_rejected_steps"]
        states = jax.vmap(packing.unpack)(t, solution.ys)
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=2e-13), self.run(solver).state, states)

    @pytest.mark.thorough
    def test_can_be_evaluated_at_any_time(self, solver):
        t = np.array([0.05, 0.15, 1.234])
        other = simulate(BALL, [0.0, *t, 3.0], rtol=1e-12, atol=1e-12, step_to_times=True, throw=True).state
        for i, time in enumerate(t):
            np.testing.assert_allclose(self.run(solver).at(time).q, other.q[i + 1], rtol=0, atol=5e-9 * ERRORS[solver])

    @pytest.mark.long
    def test_contact_extremes(self, solver):
        ours, theirs = (jaxball.contact_extremes(run) for run in (self.run(solver), simulate(BALL, TIMES, dense=True)))
        np.testing.assert_allclose(ours.least_normal_force, theirs.least_normal_force, rtol=1e-7 * ERRORS[solver])


def turned(ball, t, state):
    return state.q[1]


@pytest.mark.slow
def test_events_happen_when_they_do_in_another_run(solver):
    events = {"turned": Event(turned, terminal=True)}
    times = [simulate(BALL, TIMES, solver=method, events=events).reached for method in (solver, DOPRI8)]
    assert 0.0 < times[1] < 3.0
    np.testing.assert_allclose(times[0], times[1], rtol=0, atol=1e-8 * ERRORS[solver])


@pytest.mark.long
def test_projection(solver):
    state = simulate(BALL, TIMES[[0, -1]], solver=solver, project=True, throw=True).state
    np.testing.assert_allclose(np.linalg.norm(state.q, axis=1), 1.0, rtol=0, atol=5e-16)


@pytest.mark.slow
@pytest.mark.parametrize("differentiate", [jax.grad, jax.jacfwd], ids=["reverse", "forward"])
def test_derivatives_agree_with_those_of_dopri8(solver, differentiate):
    adjoint = diffrax.ForwardMode() if differentiate is jax.jacfwd else None

    def end(scale, method, tolerance):
        ball = Ball(
            mass=BALL.mass * scale,
            inertia=BALL.inertia,
            radius=BALL.radius,
            offset=BALL.offset,
            masses=BALL.point_masses,
        )
        run = simulate(ball, TIMES[[0, -1]], solver=method, rtol=tolerance, atol=tolerance, adjoint=adjoint)
        return run.state.z[-1, 0]

    ours = differentiate(lambda scale: end(scale, solver, 1e-11))(1.0)
    theirs = differentiate(lambda scale: end(scale, DOPRI8, 1e-12))(1.0)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-8 * ERRORS[solver])


@pytest.mark.long
def test_batches(solver):
    """Each run takes its own orders and steps."""

    def end(phidot):
        state = BallState(Omega=jnp.stack([jnp.zeros_like(phidot), phidot, jnp.zeros_like(phidot)]))
        run = simulate(BALL, TIMES[[0, -1]], state, solver=solver)
        return run.state.z[-1], run.steps

    rates = jnp.array([0.0, 2.0])
    ends, steps = jax.vmap(end)(rates)
    for i, rate in enumerate(rates):
        alone, count = end(rate)
        np.testing.assert_allclose(ends[i], alone, rtol=0, atol=1e-10)
        assert abs(int(steps[i]) - int(count)) <= 3


@pytest.mark.parametrize(
    "case",
    [
        pytest.param((BALL, reference.ball, slice(-2, None)), id="ball", marks=pytest.mark.slow),
        pytest.param((split(BALL, 100), reference.ball, slice(-2, None)), id="ball with 300 masses"),
    ],
)
def test_fewer_evaluations_by_adams_than_dopri8(case):
    ball, truth, columns = case
    counts = []
    for method in (ADAMS, DOPRI8):
        counter = Counter()
        run = simulate(ball, [0.0, 20.0], solver=CountingSolver(method, counter), throw=True)
        np.testing.assert_allclose(run.state.z[-1], truth().values[-1, columns], rtol=0, atol=1e-7)
        counts.append(counter.read())
    assert counts[0] < 0.7 * counts[1]


class Cautious(diffrax.Tsit5):
    approach = 0.02


@pytest.mark.long
def test_a_solver_says_how_near_to_the_end_of_a_slip_a_step_may_come():
    """It takes at most a fiftieth of the time until then at once, and so more steps, to the same end."""
    assert approach_of(ADAMS) == approach_of(Projected(ADAMS, lambda x: x)) < approach_of(DOPRI8)
    law = Contact(friction=0.2)
    thrown = ReleasedState(BallState(), V=(1.0, 0.0, 0.0))
    plain, cautious = (
        simulate(
            Ball(mass=1.0, inertia=(0.4, 0.45, 0.5)),
            [0.0, 2.0],
            thrown,
            contact=law,
            rtol=1e-4,
            atol=1e-4,
            solver=solver,
        )
        for solver in (diffrax.Tsit5(), Cautious())
    )
    assert int(cautious.steps) > 3 * int(plain.steps)
    np.testing.assert_allclose(cautious.state.z, plain.state.z, rtol=0, atol=1e-3)
