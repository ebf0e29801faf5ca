"""The curves that stand for shell and rails."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxball
from jaxball.plot.shapes import outline, rail_points, split, towards, wireframe

VIEWS = [(26.0, -60.0), (90.0, 0.0), (-90.0, 10.0), (0.0, 45.0)]


def test_the_wireframe_lies_on_the_sphere():
    points = 2 * wireframe()
    points = points[np.all(np.isfinite(points), axis=1)]
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 2.0, rtol=1e-14)
    np.testing.assert_allclose(points.max(axis=0), 2.0, rtol=1e-14)


@pytest.mark.parametrize(("elevation", "azimuth"), VIEWS)
def test_the_outline_is_the_great_circle_that_the_viewer_faces(elevation, azimuth):
    viewer = towards(elevation, azimuth)
    circle = 3 * outline(viewer)
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 3.0, rtol=1e-14)
    np.testing.assert_allclose(circle @ viewer, 0.0, atol=1e-14)


def test_a_sphere_is_split_into_what_is_seen_and_what_is_behind():
    viewer = towards(20.0, 30.0)
    front, back = split(wireframe(), viewer)
    visible, hidden = (np.all(np.isfinite(half), axis=1) for half in (front, back))
    assert np.all(front[visible] @ viewer >= 0)
    assert np.all(back[hidden] @ viewer <= 0)
    assert np.count_nonzero(visible | hidden) == np.count_nonzero(np.isfinite(wireframe()[:, 0]))


def test_a_tube_is_drawn_from_shell_to_shell():
    centre, direction = np.array([0.1, 0.2, -0.3]), np.array([1.0, 2.0, 2.0])
    ends = rail_points(jaxball.OnRail(jaxball.Tube(direction, centre), jaxball.ConstantRate(0.0)), 1.5)
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), 1.5, rtol=1e-14)
    np.testing.assert_allclose(np.cross(ends - centre, direction), 0.0, atol=1e-14)
    assert (ends[1] - ends[0]) @ direction > 0


def test_a_closed_rail_is_drawn_once_round():
    points = rail_points(jaxball.Driven(jaxball.Ellipse((0.5, 0.3))), 1.0)
    np.testing.assert_allclose((points[:, 0] / 0.5) ** 2 + (points[:, 2] / 0.3) ** 2, 1.0, rtol=1e-13)
    np.testing.assert_allclose(points[0], points[-1], atol=1e-15)


@pytest.mark.parametrize(
    "motion",
    [
        jaxball.Fixed,
        lambda _: jaxball.OnRail(jaxball.Tube((1.0, 0.0, 0.0), (0.0, 2.0, 0.0)), jaxball.ConstantRate(0.0)),
        lambda _: jaxball.OnRail(jaxball.FunctionRail(lambda theta, _: theta * jnp.ones(3)), jaxball.ConstantRate(0.0)),
    ],
    ids=["fixed", "outside", "open"],
)
def test_where_there_is_no_curve_there_is_none(motion):
    assert rail_points(motion((0.1, 0.0, 0.0)), 1.0) is None
