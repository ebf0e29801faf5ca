"""Bounds on where masses come hold at every sample, and are no larger than they must be."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.functions import HarmonicSeries
from jaxball.physics.limits.confinement import largest_angle, reach
from jaxball.physics.prescribed.motion import OnRail, Oscillating
from jaxball.physics.prescribed.rails import SplineRail, Tube
from jaxball.physics.prescribed.schedules import ConstantRate, Pulse, Sinusoids, Waypoints

START, END = jnp.array(0.2), jnp.array(3.0)
TIMES = jnp.linspace(START, END, 2001)
SCHEDULES = [
    ConstantRate(0.3, -0.4),
    Sinusoids(0.3, [0.2, 0.1], [2.0, 5.0], [0.1, 0.2], -0.3),
    Pulse(0.3, 0.5, -0.2, 0.5, 1.0, 1.5),
    Pulse(-0.3, -2.0, 0.4, 2.0, 2.5, 4.0),
]


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_schedules(schedule):
    largest = np.max(np.abs(jax.vmap(schedule)(TIMES)))
    assert largest <= largest_angle(schedule, START, END) <= largest + 3.5


def assert_reached(motion, excess, aside):
    """The bounds are kept, and the distance is reached but for ``excess``."""
    points, bound = np.asarray(jax.vmap(motion)(TIMES)), reach(motion, START, END)
    distance = np.max(np.linalg.norm(points, axis=1))
    assert distance <= bound.far <= distance + excess
    assert np.max(np.abs(points[:, 1])) <= bound.aside < aside


def test_free_motions():
    series = HarmonicSeries([0.1, 0.2, -0.3], [[0.3, 0.0, 0.2], [0.1, 0.1, 0.1]], [1.0, 7.0], [0.3, 0.0])
    assert_reached(Oscillating(series), excess=0.4, aside=0.4)


def test_free_motions_with_powers():
    series = HarmonicSeries([0.1, 0.2, 0.3], powers=[[0.3, 0.0, 0.2], [0.0, 0.1, 0.0]])
    assert_reached(Oscillating(series), excess=1e-12, aside=1.2)


def test_tubes():
    tube = Tube([1.0, 0.0, -0.5], [0.1, 0.0, -0.2])
    assert_reached(OnRail(tube, ConstantRate(0.3, 0.4)), excess=1e-12, aside=1e-12)


def test_what_has_no_bound():
    large = HarmonicSeries([0.1, 0.2, -0.3], [[0.3, 0.0, 0.2]], [1e7], [0.0])
    waypoints, spline = Waypoints([0.0, 1.0], [0.1, 0.2]), SplineRail(np.eye(3))
    for motion in (Oscillating(large), OnRail(Tube([1.0, 0.0, 0.0]), waypoints), OnRail(spline, SCHEDULES[0])):
        assert not np.isfinite(reach(motion, START, END).far)
