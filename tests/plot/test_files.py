"""The files of figures, and the scenes of animations."""

import matplotlib.image
import numpy as np
import pytest

from jaxball import plot
from jaxball.plot.record import record
from jaxball.plot.scene import scene
from tests.plot.geometry import overlaps

QUANTITIES = [
    "configuration",
    "body_paths",
    "space_paths",
    "angular_velocity",
    "centre_path",
    "energies",
    "power",
    "contact_force",
    "friction_ratio",
]


def ink(path):
    """The share of pixels that are not white."""
    return np.mean(np.any(matplotlib.image.imread(path)[..., :3] < 0.98, axis=-1))


def test_all_figures_of_the_disk(disk_trajectory, tmp_path):
    paths = plot.figures(disk_trajectory, tmp_path / "new" / "folder")
    assert [path.name for path in paths] == [f"disk_{name}.png" for name in ["acceleration", *QUANTITIES]]
    for path in paths:
        assert 0.005 < ink(path) < 0.3, path


def test_a_ball_without_masses_has_no_acceleration_to_show(bare_trajectory, tmp_path):
    paths = plot.figures(bare_trajectory, str(tmp_path))
    assert [path.name for path in paths] == [f"ball_{name}.png" for name in QUANTITIES]


def test_the_overview_is_one_page_of_six_panels(ball_trajectory, tmp_path):
    figure = plot.overview(ball_trajectory)
    assert len(figure.axes) == 6
    figure.savefig(tmp_path / "page.png", dpi=60)
    assert 0.01 < ink(tmp_path / "page.png") < 0.3


@pytest.mark.parametrize("body", ["ball", "disk"])
def test_the_scene_keeps_masses_on_their_rails_and_the_body_on_its_trail(body, request):
    trajectory = request.getfixturevalue(f"{body}_trajectory")
    run = record(trajectory)
    figure, show = scene(trajectory, run)
    show(13)
    lines = figure.axes[0].lines
    columns = [0, 1, 2] if body == "ball" else [0, 2]
    places = [line.get_data_3d() if body == "ball" else line.get_data() for line in lines]
    dots = [np.ravel(p) for p, line in zip(places, lines, strict=True) if line.get_marker() == "o"]
    assert len(dots) == trajectory.system.n_masses
    for i, dot in enumerate(dots, start=1):
        (rail,) = (
            np.column_stack(p)
            for p, line in zip(places, lines, strict=True)
            if np.shape(p)[1] == 241 and line.get_color() == f"{dots_colour(lines, i)}"
        )
        # A rail of radius ≤ 0.95 has 240 chords, none further from its arc than 0.95 (π/240)²/2 = 8e-5,
        # and no longer than 0.025.
        assert np.min(np.linalg.norm(rail - dot, axis=1)) < 0.0125 + 8e-5
    (trail,) = (np.column_stack(p) for p in places if np.shape(p)[1] == 14)
    np.testing.assert_allclose(trail[-1], np.asarray(trajectory.observables.contact_point)[13, columns])


@pytest.mark.parametrize("body", ["ball", "disk"])
def test_the_texts_of_a_scene_are_apart(body, request):
    trajectory = request.getfixturevalue(f"{body}_trajectory")
    figure, show = scene(trajectory, record(trajectory))
    assert any(text.get_text().startswith(f"{body.title()} with ") for text in figure.texts)
    for k in (0, 20):
        show(k)
        assert overlaps(figure) == []


def dots_colour(lines, i):
    """The colour of the dot of mass i."""
    return next(line.get_color() for line in lines if line.get_label() == f"$m_{{{i}}}$")
