"""Bounds on rails and schedules hold at every sample, and are no larger than they must be."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxball.numerics.harmonics import HarmonicSeries
from jaxball.physics.frames import SphericalFrame
from jaxball.physics.rails import BernoulliEight, Circle, Ellipse, FourierRail, GeronoEight
from jaxball.physics.schedules import ConstantRate, Pulse, Sinusoids
from jaxball.sweep.reading.furthest import furthest, reach_of_series
from jaxball.sweep.reading.reach import bounds, farthest_sample

RNG = np.random.default_rng(6)
FRAME = SphericalFrame(0.7, -0.4)
THETA = np.linspace(0, 2 * np.pi, 5001)


def stacked(item):
    """One item as a group of one in one row."""
    return jax.tree.map(lambda leaf: np.asarray(leaf)[None, None], item)


@pytest.mark.parametrize(
    ("rail", "excess"),
    [
        (Circle(0.6, (0.1, 0.3, -0.2), FRAME), 1e-4),
        (Ellipse((0.6, 0.3), (0.1, 0.3, -0.2), FRAME), 0.1),
        (Ellipse((0.6, 0.3)), 1e-3),
        (GeronoEight((0.5, 0.4)), 1e-3),
        (GeronoEight((0.5, 0.1)), 1e-3),
        (BernoulliEight(0.6, (0.0, 0.3, 0.0)), 1e-3),
        (FourierRail(RNG.normal(size=(2, 3)), RNG.normal(size=(2, 3)), (0.1, 0.2, 0.3)), 3.0),
    ],
)
def test_rails(rail, excess):
    points, found = np.asarray(rail.points(jnp.asarray(THETA))), bounds(stacked(rail))
    farthest = np.max(np.linalg.norm(points, axis=1))
    assert farthest <= found.far[0, 0] * (1 + 1e-15) <= farthest + excess
    assert np.max(np.abs(points[:, 1])) <= found.aside[0, 0] + 1e-15
    assert farthest - 0.05 < farthest_sample(stacked(rail))[0, 0] <= farthest * (1 + 1e-12)


def test_the_farthest_point_of_a_circle():
    centre, radius = np.array([0.1, 0.3, -0.2]), 0.6
    exact = np.hypot(centre[1], np.hypot(centre[0], centre[2]) + radius)
    found = bounds(stacked(Circle(radius, centre)))
    assert exact <= found.far[0, 0] < exact + 1e-4
    assert found.aside[0, 0] == centre[1]


@pytest.mark.parametrize(
    "schedule",
    [
        ConstantRate(0.3, -0.4),
        Sinusoids(0.3, [0.2, 0.1], [2.0, 5.0], [0.1, 0.2], -0.3),
        Pulse(0.3, 0.5, -0.2, 0.5, 1.0, 1.5),
        Pulse(-0.3, -2.0, 0.4, 2.0, 2.5, 4.0),
    ],
)
def test_schedules(schedule):
    t = np.linspace(0.2, 3.0, 2001)
    angles = np.abs(np.asarray(jax.vmap(schedule)(t)))
    bound = furthest(stacked(schedule), *np.array([[[0.2]], [[3.0]]]))[0, 0]
    assert np.max(angles) <= bound <= np.max(angles) + 3.5


def test_free_motions():
    series = HarmonicSeries([0.1, 0.2, -0.3], [[0.3, 0.0, 0.2], [0.1, 0.1, 0.1]], [1.0, 7.0], [0.3, 0.0])
    points = np.asarray(jax.vmap(series)(np.linspace(0.0, 9.0, 3001)))
    far, aside = reach_of_series(stacked(series), *np.array([[[0.0]], [[9.0]]]))
    assert np.max(np.linalg.norm(points, axis=1)) <= far[0, 0] < 1.0
    assert np.max(np.abs(points[:, 1])) <= aside[0, 0] < 0.4
