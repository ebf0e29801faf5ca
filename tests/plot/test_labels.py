"""Names are placed where they hide nothing."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxball.plot.labels import name_points, places
from tests.plot.geometry import overlaps

NONE = np.zeros((0, 2))
PAGE = (200.0, 200.0)
SIZE = np.array([[14.0, 9.0]])


def covered(centre, size, points):
    """Which points lie under a name."""
    return np.all(np.abs(points - centre) < size / 2, axis=1)


def test_a_name_alone_stands_upwards_to_the_right_and_clear_of_its_mark():
    (centre,) = places(np.array([[100.0, 100.0]]), SIZE, NONE, NONE, NONE, PAGE, room=4.0)
    assert np.all(centre > 100.0)
    assert np.linalg.norm(np.maximum(np.abs(centre - 100.0) - SIZE[0] / 2, 0.0)) > 4.0


def test_a_name_moves_off_curves_and_marks():
    x = np.arange(0.0, 200.0)
    curve = np.concatenate([np.column_stack([x, x]), np.column_stack([x, np.full(200, 115.0)])])
    mark = np.array([[110.0, 90.0]])
    (centre,) = places(np.array([[100.0, 100.0]]), SIZE, curve, mark, NONE, PAGE, room=4.0)
    assert not np.any(covered(centre, SIZE[0], np.concatenate([curve, mark])))


def test_names_of_one_point_are_apart_and_on_the_page():
    anchors, sizes = np.tile([[3.0, 3.0]], (5, 1)), np.tile(SIZE, (5, 1))
    centres = places(anchors, sizes, NONE, NONE, NONE, PAGE, room=2.0)
    for i in range(5):
        for j in range(i):
            assert np.any(np.abs(centres[i] - centres[j]) >= SIZE[0])
    assert np.all(centres >= SIZE[0] / 2)


def test_a_background_is_crossed_rather_than_a_curve():
    angles = np.linspace(0.0, 2 * np.pi, 721)
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    curve = 100.0 + np.concatenate([r * around[:540] for r in np.arange(6.0, 70.0, 4.0)])  # three quarters of circles
    faint = 100.0 + np.concatenate([r * around[540:] for r in np.arange(6.0, 70.0, 4.0)])
    (centre,) = places(np.array([[100.0, 100.0]]), SIZE, curve, NONE, faint, PAGE, room=4.0)
    assert not np.any(covered(centre, SIZE[0], curve))
    assert np.any(covered(centre, SIZE[0], faint))


def test_the_same_points_have_the_same_places():
    points = np.random.default_rng(0).uniform(20.0, 180.0, (12, 2))
    arguments = (points, np.tile(SIZE, (12, 1)), NONE, points, NONE, PAGE)
    np.testing.assert_array_equal(places(*arguments, room=3.0), places(*arguments, room=3.0))


def crowded(size, dpi):
    """Eight points beside one another on a bundle of lines."""
    ax = Figure(figsize=size, dpi=dpi, layout="constrained").add_subplot()
    for slope in np.linspace(-1.0, 1.0, 5):
        ax.plot([-1, 1], [-slope, slope])
    points = np.column_stack([np.linspace(-0.2, 0.2, 8), np.zeros(8)])
    ax.plot(*points.T, "o", ms=6)
    name_points(ax, points, [f"$m_{{{i}}}$" for i in range(1, 9)], ["k"] * 8, room=3.0)
    return ax.figure


@pytest.mark.thorough
def test_names_are_placed_anew_when_the_figure_has_another_size():
    figure = crowded((4.0, 4.0), 100)
    assert overlaps(figure) == []
    figure.set_size_inches(3.0, 2.5)
    assert overlaps(figure) == []
    figure.set_dpi(220)
    assert overlaps(figure) == []
