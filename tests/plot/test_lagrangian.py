"""Systems with a Lagrangian: panels by kinds of coordinates, and pictures by a function of one's own."""

import numpy as np
import pytest
from PIL import Image

import jaxball
from jaxball.physics.classical import ChaplyginSleigh, LagrangianState
from tests.support.pages import arrays_of
from tests.support.sentences import refuses

TIMES = np.linspace(0.0, 2.0, 9)


@pytest.fixture(scope="module")
def sleigh():
    """A sleigh that slides ahead and turns."""
    state = LagrangianState([0.0, 0.0, 0.2], [np.cos(0.2), np.sin(0.2), 1.0])
    return jaxball.simulate(ChaplyginSleigh(inertia=0.4, ahead=0.5), TIMES, state, throw=True)


def blade(t, q):
    """The place of the blade, and a line along it."""
    place = np.asarray(q[:2])
    ahead = np.array([np.cos(q[2]), np.sin(q[2])])
    return [place[None], np.stack([place, place + ahead])]


@pytest.mark.thorough
def test_positions_angles_and_rates_are_apart(sleigh):
    figure = sleigh.plot()
    assert [ax.get_ylabel() for ax in figure.axes] == [
        "positions",
        "angles",
        "rates",
        "angular rates",
        "constraint forces",
    ]
    lines_of = [[line for line in ax.get_lines() if not line.get_label().startswith("_")] for ax in figure.axes]
    q, qdot = np.asarray(sleigh.state.q), np.asarray(sleigh.state.qdot)
    expected = q[:, :2], q[:, 2:], qdot[:, :2], qdot[:, 2:], sleigh.multipliers
    for lines, values in zip(lines_of, expected, strict=True):
        np.testing.assert_allclose(np.stack([line.get_ydata() for line in lines], axis=1), values, atol=1e-12)


@pytest.mark.thorough
def test_a_picture_shows_what_the_function_draws(sleigh, tmp_path):
    figure = sleigh.snapshot(1.0, picture=blade)
    point, along = figure.axes[0].get_lines()[-2:]
    q = np.asarray(sleigh.state.q)[4]
    np.testing.assert_allclose(point.get_xydata(), q[None, :2])
    np.testing.assert_allclose(np.diff(along.get_xydata(), axis=0), [[np.cos(q[2]), np.sin(q[2])]])
    with Image.open(sleigh.animate(tmp_path / "film.gif", fps=2, dpi=20, picture=blade).path) as film:
        assert film.n_frames == 5


def test_a_view_has_what_the_function_draws(sleigh):
    """A picture of a plane stands upright: its second axis is the third of the page."""
    document = sleigh.view(picture=blade).document
    body, arrays = document["bodies"][0], arrays_of(document)
    for k, t in enumerate(TIMES):
        for name, points in zip(("line_0", "line_1"), blade(t, np.asarray(sleigh.state.q)[k]), strict=True):
            np.testing.assert_allclose(arrays[name][k], np.insert(points, 1, 0.0, axis=1), atol=1e-6)
    assert body["body"] == "drawn"
    low, high = np.min(document["corners"], axis=0), np.max(document["corners"], axis=0)
    drawn = np.concatenate([arrays["line_0"].reshape(-1, 3), arrays["line_1"].reshape(-1, 3)])
    np.testing.assert_allclose([low, high], [drawn.min(axis=0), drawn.max(axis=0)], atol=1e-6)
    np.testing.assert_allclose(arrays["q"], np.asarray(sleigh.state.q), atol=1e-6)
    titles = [graph["title"] for graph in document["plots"]]
    assert titles == [
        "Positions",
        "Angles",
        "Rates",
        "Angular rates",
        "Constraint forces",
        "Laws, change since the start",
    ]


@pytest.mark.thorough
def test_a_picture_may_be_in_space(sleigh):
    figure = sleigh.snapshot(picture=lambda t, q: [np.column_stack([line, line[:, :1]]) for line in blade(t, q)])
    x, y, z = figure.axes[0].get_lines()[-2].get_data_3d()
    np.testing.assert_allclose([x, y, z], np.asarray(sleigh.state.q)[-1][[0, 1, 0], None])


@pytest.mark.thorough
def test_what_is_no_picture_is_told(sleigh):
    with refuses(ValueError, "picture"):
        sleigh.snapshot()
    with refuses(TypeError, "picture"):
        sleigh.animate(picture=lambda t: [])._repr_html_()
    for wrong in ([], np.zeros((2, 2)), [np.zeros((2, 4))], [np.zeros((1, 2)), np.zeros((1, 3))]):
        with refuses(TypeError, "picture(t, q)"):
            sleigh.snapshot(picture=lambda t, q, wrong=wrong: wrong)
    ball = jaxball.simulate(jaxball.Disk(mass=1.0, inertia=0.5), [0.0, 1.0], jaxball.DiskState(phidot=-1.0))
    with refuses(ValueError):
        ball.snapshot(picture=blade)
    with refuses(ValueError, "picture"):
        ball.view(picture=blade)
    with refuses(ValueError, "picture"):
        sleigh.view()
    with refuses(ValueError):
        sleigh.view(picture=lambda t, q: blade(t, q)[: 1 if t > 1 else 2])
