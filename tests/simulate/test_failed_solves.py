"""A solve that fails says so: a status and a sentence on the result, an exception only where asked for."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball import Status
from jaxball.control import Push
from jaxball.physics.forces.force import Wrenches
from tests.support.paper import paper_ball
from tests.support.sentences import refuses, said

TIMES = np.linspace(0.0, 2.0, 5)
SHELL = {"mass": 1.0, "inertia": (0.5, 0.6, 0.7)}


def breaks_off(t, end):
    """A schedule that is not a number after ``end``."""
    return jnp.where(t < end, t, jnp.nan)


@pytest.fixture(scope="module")
def broken():
    schedule = jaxball.FunctionSchedule(breaks_off, jnp.asarray(1.3))
    mass = jaxball.PointMass(0.5, jaxball.OnRail(jaxball.Circle(0.5), schedule))
    return jaxball.Ball(**SHELL, masses=[mass])


@pytest.mark.thorough
def test_too_many_steps_keep_what_was_computed():
    times = np.linspace(0.0, 20.0, 41)
    run = jaxball.simulate(paper_ball(), times, max_steps=16)
    assert run.status == Status.MAX_STEPS
    assert not run.ok
    assert 0.2 < run.reached < 20
    assert run.steps == 16
    reached = f"{float(run.reached):.10g}"
    assert f"t = {reached} " in run.message
    said(
        run.message.replace(reached, f"{run.reached:.2f}"), "max_steps"
    )  # of an estimate of errors, and so of rounding
    saved = np.asarray(run.state.Omega)
    beyond = times > float(run.reached)
    assert np.all(np.isnan(saved[beyond]))
    assert np.all(np.isfinite(saved[~beyond]))
    # What was computed before the failure is the run itself.
    whole = jaxball.simulate(paper_ball(), times).state.Omega
    np.testing.assert_allclose(saved[~beyond], whole[~beyond], atol=1e-12)


@pytest.mark.long
def test_a_field_that_is_not_finite_is_found_with_its_time(broken):
    run = jaxball.simulate(broken, TIMES)
    assert run.status == Status.NOT_FINITE
    np.testing.assert_allclose(run.reached, 1.3, atol=1e-6)
    assert "not finite" in run.message
    assert np.all(np.isfinite(run.state.q[TIMES < 1.3]))
    assert np.all(np.isnan(run.state.q[TIMES > 1.3]))


def test_an_exception_is_raised_where_asked_for(broken):
    with refuses(jaxball.SolveError, "1.3"):
        jaxball.simulate(broken, TIMES, throw=True)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mass", -1.0),
        ("mass", np.nan),
        ("radius", 0.0),
        ("inertia", (0.1, 0.1, 1.0)),
        ("inertia", (0.5, -0.6, 0.7)),
        ("gravity", np.inf),
        ("offset", (0.0, 0.0, 1.5)),
    ],
)
def test_parameters_that_no_body_can_have(name, value):
    ball = jaxball.Ball(**{**SHELL, name: value})
    run = jaxball.simulate(ball, TIMES)
    assert run.status == Status.IMPOSSIBLE
    said(run.message)
    assert run.reached == 0
    assert np.all(np.isnan(run.state.q))
    said(jaxball.problems(ball)[0], name)
    with refuses(jaxball.SolveError, name):
        run.raise_if_failed()


@pytest.mark.thorough
def test_a_point_mass_that_no_body_can_have():
    masses = [jaxball.PointMass(m, jaxball.Fixed([0.0, 0.0, 0.1])) for m in (0.5, -0.5)]
    ball = jaxball.Ball(**SHELL, masses=masses)
    assert jaxball.simulate(ball, TIMES).status == Status.IMPOSSIBLE
    (problem,) = jaxball.problems(ball)
    said(problem, "masses[1].mass")


@pytest.mark.thorough
def test_a_push_that_would_end_before_it_begins():
    pushes = (Push((0.1, 0.0, 0.0), start=0.5, duration=0.2), Push((0.1, 0.0, 0.0), start=0.5, duration=-0.2))
    ball = jaxball.Ball(**SHELL, force=Wrenches(pushes))
    assert jaxball.simulate(ball, TIMES).status == Status.IMPOSSIBLE
    (problem,) = jaxball.problems(ball)
    said(problem, "force.terms[1].duration")


def test_nothing_is_wrong_with_the_papers_ball():
    assert jaxball.problems(paper_ball()) == []


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("state", "named"),
    [
        (jaxball.BallState(Omega=[np.nan, 0.0, 0.0]), "state.Omega"),
        (jaxball.BallState(q=[1.0, 0.1, 0.0, 0.0]), "state.q"),
        (jaxball.physics.RotationState(Lambda=2 * np.eye(3)), "state.Lambda"),
        (jaxball.physics.RotationState(Lambda=-np.eye(3)), "state.Lambda"),
        (jaxball.physics.ReducedState(Gamma=[0.0, 0.0, 0.9]), "state.Gamma"),
    ],
    ids=["not finite", "no versor", "stretched", "mirrored", "no unit vector"],
)
def test_an_initial_state_that_cannot_be(state, named):
    ball = jaxball.Ball(**SHELL)
    run = jaxball.simulate(ball, TIMES, state)
    assert run.status == Status.IMPOSSIBLE
    said(run.message, named)
    assert jaxball.problems(ball, state)[0] in run.message


@pytest.mark.thorough
def test_a_failed_run_does_not_spoil_its_batch():
    masses = jnp.asarray([1.0, -1.0, 2.0])
    base = jaxball.Ball(**SHELL, offset=(0.1, 0.0, -0.1))

    @jax.jit
    @jax.vmap
    def run(mass):
        ball = eqx.tree_at(lambda ball: ball.mass, base, mass)
        solved = jaxball.simulate(ball, TIMES)
        return solved.status, solved.state.z

    status, z = run(masses)
    np.testing.assert_array_equal(status, [Status.SUCCESS, Status.IMPOSSIBLE, Status.SUCCESS])
    assert np.all(np.isfinite(z[::2]))
    assert np.all(np.isnan(z[1]))
