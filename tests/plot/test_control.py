"""Figures of feedback: what they hold, against the arrays of what they show."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

import jaxball
from jaxball import plot
from jaxball.control import tvlqr
from jaxball.control.estimation.estimate import Belief, Followed, LoopEstimate
from jaxball.plot.style import subject
from tests.control import robots
from tests.support.sentences import refuses

PHI, PHIDOT = r"$\phi$", r"$\dot{\phi}$"


@pytest.fixture(scope="module")
def track():
    run = jaxball.simulate(robots.with_pendulum(jaxball.Motor(0.0, limit=0.2)), [0.0, 2.0])
    return tvlqr(run, Q={"phi": 1.0, "theta": 1.0}, R=1.0, sample=0.1)


@pytest.fixture(scope="module")
def loops(track):
    without = track.feedforward()
    return {name: one.closed_loop({"phi": 0.3}) for name, one in (("without", without), ("with", track))}


@pytest.mark.long
def test_gains_are_drawn_but_those_that_are_zero(track):
    """z has weight 0, and no gain."""
    lines = {line.get_label(): line.get_ydata() for line in track.plot().lines}
    assert {PHI, PHIDOT, r"$\theta_{1, 1}$", r"$\dot{\theta}_{1, 1}$"} == {
        name for name in lines if not name.startswith("_")
    }
    np.testing.assert_allclose(lines[PHIDOT], track.gains[:, 0, 1], rtol=0, atol=1e-12)
    with refuses(ValueError):
        track.plot("mechanisms[1].joints[0]")


@pytest.mark.long
def test_paths_are_those_of_the_loops_and_of_the_motion(track, loops):
    lines = {line.get_label(): line.get_ydata() for line in plot.held_paths(loops).lines}
    np.testing.assert_allclose(lines["with"], loops["with"].states.z, rtol=0, atol=1e-12)
    np.testing.assert_allclose(lines["without"], loops["without"].states.z, rtol=0, atol=1e-12)
    np.testing.assert_allclose(lines["motion"], track.nominal.states.z, rtol=0, atol=1e-12)
    with refuses(ValueError):
        plot.held_paths({})


@pytest.mark.thorough
def test_inputs_are_steps_within_lines_at_their_limits(loops):
    ax = plot.held_inputs(loops)
    steps = {patch.get_label(): patch.get_data() for patch in ax.patches}
    np.testing.assert_array_equal(steps["with"].values, loops["with"].u[:, 0])
    np.testing.assert_array_equal(steps["with"].edges, loops["with"].times)
    assert {line.get_ydata()[0] for line in ax.lines} == {-0.2, 0.2}
    assert ax.figure.get_suptitle() == subject(loops["with"].plant.system)


@pytest.mark.thorough
def test_a_map_shows_which_starts_come_back(track):
    found = track.basin({"phi": [-1.0, 0.0, 1.0], "phidot": [0.0, 3.0]}, Q={"phi": 1.0}, within=0.3)
    ax = found.plot()
    np.testing.assert_array_equal(np.ravel(ax.collections[0].get_array()), found.returned.astype(float))
    assert (ax.get_ylabel(), ax.get_xlabel()) == (PHI, PHIDOT)
    assert ax.figure.get_suptitle() == subject(track.sampled.system)
    apart = track.basin(np.zeros((2, 5)))
    with refuses(ValueError, "starts"):
        apart.plot()


@pytest.mark.thorough
def test_an_estimate_shows_normalised_squares_with_their_bounds():
    """Of one error that is four standard deviations large, and of innovations of two readings or of none."""
    count = 3
    states, truth = (jax.vmap(lambda z: jaxball.DiskState(z=z))(jnp.array([0.0, z, 0.0])) for z in (0.0, 2.0))
    P = jnp.zeros((count, 3, 3)).at[:, 2, 2].set(0.25)
    nis = jnp.array([1.0, jnp.nan, 9.0])
    followed = Followed(Belief(states, jnp.zeros((count, 0)), P), nis, jnp.array([2, 0, 2]))
    found = LoopEstimate(jnp.arange(3.0), ("phi", "phidot", "z"), (), followed)
    of_errors, of_innovations = found.plot(truth).axes[-2:]
    for ax, squares, degrees in ((of_errors, [0.0, 16.0, 0.0], 1), (of_innovations, nis, 2)):
        shown, low, high = (line.get_ydata() for line in ax.lines[:3])
        np.testing.assert_allclose(shown, squares, rtol=1e-12)
        expected = chi2.ppf([[0.025], [0.975]], degrees) * np.ones(count)
        expected[:, ~np.isfinite(squares)] = np.nan
        np.testing.assert_allclose([low, high], expected, rtol=1e-12)
    assert len(found.plot().axes) == 4  # without the truth there are no errors to normalise
