"""Closed loops against the same inputs solved in one run, against linear recursions, and against differences."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.control import Push, tvlqr
from tests.control import robots
from tests.support.sentences import refuses

H = 0.05
WEIGHTS = {"phi": 1.0, "theta": 1.0}


@pytest.fixture(scope="module")
def track():
    """A disk that its pendulum holds at rest."""
    run = jaxball.simulate(robots.with_pendulum(jaxball.Motor(0.0, limit=0.08)), [0.0, 4.0])
    return tvlqr(run, Q=WEIGHTS, R=1.0, sample=H)


START = {"phi": 0.3, "thetadot": -0.2}


@pytest.mark.long
def test_a_closed_loop_is_the_run_with_its_inputs(track):
    """Both solve with tolerances of 1e-10, over 80 samples or at once; the push ends within samples."""
    push = Push((0.2, 0.0, 0.0), start=1.02, duration=0.31)
    loop = track.closed_loop(START, push=push)
    again = jaxball.simulate(loop.run.system, loop.times, loop.run.start)
    for name in ("phi", "phidot", "z", "theta", "thetadot"):
        np.testing.assert_allclose(getattr(again.state, name), getattr(loop.states, name), rtol=0, atol=1e-8)
    assert loop.ok
    assert loop.run.ok
    efforts = loop.run.observables.joint_efforts[:-1, 0]
    np.testing.assert_allclose(efforts, loop.u[:, 0], rtol=0, atol=1e-12)


@pytest.mark.long
def test_inputs_are_limited_and_late(track):
    """Feedback of sample k acts at sample k + 2, and the sum with the motion's own input is within the limit."""
    loop = track.closed_loop(START, delay=2)
    np.testing.assert_array_equal(loop.du[:2], 0)
    wanted = [-track.gains[k] @ loop.xi[k] - track.regulator.k[k] for k in range(track.nominal.samples - 2)]
    expected = np.clip(track.nominal.u[2:] + np.stack(wanted), -0.08, 0.08)
    np.testing.assert_allclose(loop.u[2:], expected, rtol=0, atol=1e-12)
    assert float(jnp.max(jnp.abs(loop.u))) == 0.08
    assert bool(loop.saturated.any())


@pytest.mark.thorough
def test_after_the_end_the_last_state_is_held(track):
    """Small deviations decay by e in 3 units of time, as eigenvalues of A − B K say: in 15, from 0.3 to 0.002."""
    loop = track.closed_loop(START, samples=300)
    assert float(loop.times[-1]) == pytest.approx(300 * H)
    np.testing.assert_allclose(loop.xi[-1, [0, 3]], 0, atol=0.02)


@pytest.mark.thorough
def test_without_feedback_nothing_is_added(track):
    loop = track.feedforward().closed_loop(START)
    np.testing.assert_array_equal(loop.du, 0)
    assert float(jnp.max(jnp.abs(loop.xi[-20:, 0]))) > 0.1


@pytest.mark.thorough
def test_a_robot_with_other_parameters_comes_back_too(track):
    """It decays about as fast as the robot of the design."""
    heavier = robots.with_pendulum(jaxball.Motor(0.0), mass=1.2 * robots.MASS)
    loop = track.closed_loop(START, system=heavier, samples=300)
    assert float(loop.plant.system.mass) == pytest.approx(1.2 * robots.MASS)
    np.testing.assert_allclose(loop.xi[-1, [0, 3]], 0, atol=0.02)


@pytest.mark.parametrize(
    ("derivative", "adjoint"),
    [
        (jax.jacfwd, None),
        (jax.grad, None),
        pytest.param(jax.jacfwd, diffrax.ForwardMode(), marks=pytest.mark.slow),
        pytest.param(jax.grad, diffrax.RecursiveCheckpointAdjoint(), marks=pytest.mark.slow),
    ],
)
@pytest.mark.long
def test_gradients_of_the_cost_are_those_of_differences(track, derivative, adjoint):
    """By all gains along a direction, and by the mass. Limits are off, at which the cost has kinks.

    Central differences with steps of 1e-4 of sizes 1 have errors of 1e-8, relative to derivatives of size 0.01 to 1.
    """
    along = jnp.asarray(np.random.default_rng(0).normal(size=track.gains.shape))

    def cost(by):
        changed = eqx.tree_at(lambda f: f.regulator.K, track, track.gains + by[0] * along)
        system = robots.with_pendulum(jaxball.Motor(0.0), mass=robots.MASS + by[1])
        loop = changed.closed_loop(START, system=system, limits=1e3, samples=20, adjoint=adjoint)
        return track.cost(loop.xi, loop.du)

    found = jaxball.jit(derivative(cost))(jnp.zeros(2))
    compiled = jaxball.jit(cost)
    steps = 1e-4 * jnp.eye(2)
    expected = [(float(compiled(e)) - float(compiled(-e))) / 2e-4 for e in steps]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-8)


@pytest.mark.long
def test_a_basin_is_that_of_single_closed_loops(track):
    """Lanes round differently, which the closed loop damps: ends agree to its tolerance."""
    grid = {"phi": np.linspace(-3.0, 3.0, 5), "phidot": np.linspace(-1.5, 1.5, 4)}
    found = track.basin(grid, Q={"phi": 1.0}, within=0.5, delay=1)
    assert 0 < found.share < 1
    for k in (0, 2, 13):
        loop = track.closed_loop(found.starts[k], delay=1)
        np.testing.assert_allclose(found.ends.xi[k], loop.xi[-1], rtol=0, atol=1e-7)
        assert bool(found.returned[k]) == (abs(float(loop.xi[-1, 0])) < 0.5)
        seen = loop.run.observables
        assert float(found.ends.friction_needed[k]) == pytest.approx(float(seen.friction_ratio[:-1].max()), abs=1e-7)
        assert float(found.ends.least_normal_force[k]) == pytest.approx(float(seen.normal_force[:-1].min()), abs=1e-7)
    data = found.dataset()
    assert data["returned"].dims == ("phi", "phidot")
    np.testing.assert_array_equal(data["returned"].values.ravel(), found.returned)
    strict = track.basin(grid, Q={"phi": 1.0}, within=0.5, delay=1, friction=0.05)
    np.testing.assert_array_equal(strict.returned, found.returned & (found.ends.friction_needed <= 0.05))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"start": {"psi": 1.0}}, "start"),
        ({"start": [1.0, 2.0]}, "start"),
        ({"limits": [1.0, 2.0]}, "limits"),
        ({"limits": -1.0}, "limits"),
        ({"delay": -1}, "delay"),
        ({"samples": 0}, "samples"),
        ({"system": robots.with_wheel()}, None),
    ],
)
def test_bad_input_gets_a_sentence(track, options, named):
    if named is None:  # a robot of the same coordinates is another robot, and no error
        assert track.closed_loop(**options).plant.system.n_masses == 0
        return
    with refuses(ValueError, named):
        track.closed_loop(**options)


@pytest.mark.thorough
def test_a_robot_with_other_coordinates_is_refused(track):
    two = [jaxball.physics.double_pendulum((0.3, 0.2), (0.3, 0.2), drives=(jaxball.Motor(0.0), None))]
    with refuses(ValueError, "system"):
        track.closed_loop(system=jaxball.Disk(mass=1.0, inertia=0.5, mechanisms=two))


@pytest.mark.thorough
def test_starts_of_other_shapes_are_refused(track):
    with refuses(ValueError, "starts"):
        track.basin(np.zeros((3, 4)))
    with refuses(ValueError, "starts"):
        track.basin({"phi": [0.0], "x": [0.0]})
