"""Other numbers never compile anew, batches equal single runs, and dense output equals saved states."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from tests.support.paper import BALL_RADII, paper_ball
from tests.support.sentences import refuses

TIMES = np.linspace(0.0, 2.0, 5)
traces = []


def counted(theta, radius):
    """A rail that notes each time its Python code runs, that is, each time it is traced."""
    traces.append(theta)
    return radius * jnp.stack([jnp.cos(theta), jnp.zeros_like(theta), jnp.sin(theta)])


def ball(mass=1.0, radius=0.5, rate=1.0, gravity=1.0):
    rail = jaxball.FunctionRail(counted, jnp.asarray(radius))
    motion = jaxball.OnRail(rail, jaxball.Pulse(0.3, rate=rate))
    return jaxball.Ball(mass=mass, inertia=(0.5, 0.6, 0.7), gravity=gravity, masses=[jaxball.PointMass(0.4, motion)])


@pytest.mark.long
def test_other_numbers_do_not_trace_again():
    start = jaxball.BallState(Omega=[0.1, 0.2, 0.3])
    first = jaxball.simulate(ball(), TIMES, start)
    first.observables  # noqa: B018
    count = len(traces)
    assert count > 0
    calls = [
        {"system": ball(mass=2.0, radius=0.7, rate=-1.5, gravity=9.8)},
        {"rtol": 1e-8, "atol": 1e-9},
        {"rtol": jnp.asarray(1e-7, dtype=float), "atol": np.float64(1e-9)},
        {"times": np.linspace(1.0, 4.0, 5)},
        {"times": np.array([0.0, 0.1, 0.5, 0.6, 1.0])},
        {"state": jaxball.BallState(q=[0.6, 0.8, 0.0, 0.0], z=[3.0, 4.0])},
    ]
    for changed in calls:
        arguments = {"system": ball(), "times": TIMES, "state": start, **changed}
        run = jaxball.simulate(**arguments)
        assert run.ok
        run.observables  # noqa: B018
        assert len(traces) == count, changed
    jaxball.simulate(ball(), np.linspace(0.0, 2.0, 6), start)
    assert len(traces) > count


@pytest.fixture(scope="module")
def batch():
    """Balls of other masses and radii from other initial states, all at once."""
    rng = np.random.default_rng(91)
    base = paper_ball()
    count = 4
    masses = jnp.asarray(rng.uniform(0.5, 1.5, (count, 3)))
    radii = jnp.asarray(np.array(BALL_RADII) * rng.uniform(0.8, 1.0, (count, 3)))
    Omega = jnp.asarray(0.3 * rng.normal(size=(count, 3)))

    def member(masses, radii):
        def numbers(ball):
            return ball.groups[0].mass, ball.groups[0].motion.rail.radius

        return eqx.tree_at(numbers, base, (masses, radii))

    systems = [member(*numbers) for numbers in zip(masses, radii, strict=True)]
    states = [jaxball.BallState(Omega=row) for row in Omega]

    @jax.jit
    @jax.vmap
    def run(masses, radii, Omega):
        solved = jaxball.simulate(member(masses, radii), TIMES, jaxball.BallState(Omega=Omega))
        return solved.state, solved.status

    return run(masses, radii, Omega), systems, states


@pytest.mark.long
def test_a_batch_equals_its_members(batch):
    """Lanes take their own steps; what differs is rounding in another order, which the motion amplifies."""
    (states, status), systems, starts = batch
    np.testing.assert_array_equal(status, jaxball.Status.SUCCESS)
    for k, (system, start) in enumerate(zip(systems, starts, strict=True)):
        alone = jaxball.simulate(system, TIMES, start).state
        np.testing.assert_allclose(states.q[k], alone.q, atol=1e-11)
        np.testing.assert_allclose(states.Omega[k], alone.Omega, atol=1e-11)
        np.testing.assert_allclose(states.z[k], alone.z, atol=1e-11)


@pytest.fixture(scope="module")
def dense():
    return jaxball.simulate(paper_ball(), TIMES, dense=True, max_steps=256)


@pytest.mark.thorough
def test_dense_output_at_saved_times_is_what_was_saved(dense):
    found = dense.at(TIMES)
    np.testing.assert_allclose(found.q, dense.state.q, atol=1e-14)
    np.testing.assert_allclose(found.z, dense.state.z, atol=1e-14)


def test_dense_output_outside_the_run_is_nan(dense):
    found = dense.at(jnp.asarray([TIMES[0] - 0.1, TIMES[0], TIMES[-1], TIMES[-1] + 0.1]))
    np.testing.assert_array_equal(np.isnan(found.z[:, 0]), [True, False, False, True])


def test_dense_output_at_times_of_any_shape(dense):
    times = np.linspace(TIMES[0], TIMES[-1], 6)
    np.testing.assert_array_equal(dense.at(times.reshape(2, 3)).q, np.reshape(dense.at(times).q, (2, 3, 4)))


@pytest.mark.thorough
def test_dense_output_must_be_asked_for():
    run = jaxball.simulate(paper_ball(), TIMES)
    with refuses(ValueError, "at"):
        run.at(0.5)


def test_a_run_says_what_it_is():
    text = str(jaxball.simulate(paper_ball(), TIMES))
    assert "Trajectory of a ball with 3 point masses" in text
    assert "5 times from 0 to 2" in text
    assert "reached t = 2" in text


@pytest.mark.long
def test_versor_and_matrix_runs_are_one_motion():
    """Two sets of variables, one motion: they differ by the tolerance of 1e-12, amplified."""
    base, start = ball(), jaxball.BallState(Omega=[0.1, -0.2, 0.3])
    tolerances = {"rtol": 1e-12, "atol": 1e-12}
    versor = jaxball.simulate(base, TIMES, start, **tolerances)
    matrix = jaxball.simulate(base, TIMES, jaxball.physics.RotationState(Omega=start.Omega), **tolerances)
    Lambda = np.asarray(jax.vmap(jaxball.numerics.versor.rotation_matrix)(versor.state.q))
    np.testing.assert_allclose(matrix.state.Lambda, Lambda, atol=1e-9)
    np.testing.assert_allclose(matrix.state.z, versor.state.z, atol=1e-9)
    np.testing.assert_allclose(
        matrix.observables.energy, versor.observables.energy, rtol=1e-9, err_msg="observed through its matrix"
    )
