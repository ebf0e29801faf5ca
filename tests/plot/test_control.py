"""Figures of feedback: what they hold, against the arrays of what they show."""

import numpy as np
import pytest

import jaxball
from jaxball import plot
from jaxball.control import Feedforward, basin, closed_loop, tvlqr
from tests.control import robots


@pytest.fixture(scope="module")
def track():
    run = jaxball.simulate(robots.with_pendulum(jaxball.Motor(0.0, limit=0.2)), [0.0, 2.0])
    return tvlqr(run, Q={"phi": 1.0, "theta": 1.0}, R=1.0, sample=0.1)


@pytest.fixture(scope="module")
def loops(track):
    without = Feedforward(track.sampled, track.nominal)
    return {name: closed_loop(one, {"phi": 0.3}) for name, one in (("without", without), ("with", track))}


def test_gains_are_drawn_but_those_that_are_zero(track):
    """z has weight 0, and no gain."""
    lines = {line.get_label(): line.get_ydata() for line in plot.gains(track).lines}
    assert {"phi", "phidot", "theta[0]", "thetadot[0]"} == {name for name in lines if not name.startswith("_")}
    np.testing.assert_allclose(lines["phidot"], track.gains[:, 0, 1], rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="must be one of mechanisms"):
        plot.gains(track, "mechanisms[1].joints[0]")


def test_paths_are_those_of_the_loops_and_of_the_motion(track, loops):
    lines = {line.get_label(): line.get_ydata() for line in plot.held_paths(loops).lines}
    np.testing.assert_allclose(lines["with"], loops["with"].states.z, rtol=0, atol=1e-12)
    np.testing.assert_allclose(lines["without"], loops["without"].states.z, rtol=0, atol=1e-12)
    np.testing.assert_allclose(lines["motion"], track.nominal.states.z, rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="must have one closed loop or more, but it is empty"):
        plot.held_paths({})


def test_inputs_are_steps_within_lines_at_their_limits(loops):
    ax = plot.held_inputs(loops)
    steps = {patch.get_label(): patch.get_data() for patch in ax.patches}
    np.testing.assert_array_equal(steps["with"].values, loops["with"].u[:, 0])
    np.testing.assert_array_equal(steps["with"].edges, loops["with"].times)
    assert {line.get_ydata()[0] for line in ax.lines} == {-0.2, 0.2}


def test_a_map_shows_which_starts_come_back(track):
    found = basin(track, {"phi": [-1.0, 0.0, 1.0], "phidot": [0.0, 3.0]}, Q={"phi": 1.0}, within=0.3)
    ax = plot.basin_map(found)
    np.testing.assert_array_equal(np.ravel(ax.collections[0].get_array()), found.returned.astype(float))
    assert ax.get_ylabel() == "phi"
    apart = basin(track, np.zeros((2, 5)))
    with pytest.raises(ValueError, match="must be a dictionary of two directions"):
        plot.basin_map(apart)
