"""The files of figures and animations."""

import itertools

import matplotlib.image
import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from PIL import Image

from jaxball import plot
from jaxball.plot.animation import frames
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


def test_a_gif_has_a_frame_for_each_instant(disk_trajectory, tmp_path):
    path = plot.animate(disk_trajectory, tmp_path / "disk.gif", fps=2, speed=10.0, dpi=40)
    with Image.open(path) as film:
        assert film.n_frames == 5
        assert film.info["duration"] == 500
        pictures = []
        for k in range(5):
            film.seek(k)
            pictures.append(np.asarray(film.convert("L"), dtype=float))
    for before, after in itertools.pairwise(pictures):
        assert np.any(before != after)


@pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="ffmpeg is not installed")
def test_an_mp4_where_ffmpeg_is_there(ball_trajectory, tmp_path):
    path = plot.animate(ball_trajectory, tmp_path / "ball", fps=1, speed=10.0, dpi=40)
    assert path == tmp_path / "ball.mp4"
    assert path.read_bytes()[4:8] == b"ftyp"


def test_without_ffmpeg_a_gif(bare_trajectory, tmp_path, monkeypatch):
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    path = plot.animate(bare_trajectory, tmp_path / "bare", fps=1, dpi=30)
    assert path == tmp_path / "bare.gif"
    with pytest.raises(ValueError, match=r"^Argument `path` must end in \.gif where ffmpeg is not installed"):
        plot.animate(bare_trajectory, tmp_path / "bare.mp4")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"path": "film.avi"}, r"^Argument `path` must end in \.mp4 or \.gif, but it is 'film\.avi'\.$"),
        ({"fps": 0}, r"^Argument `fps` must be a positive number, but it is 0\.$"),
        ({"speed": -1.0}, r"^Argument `speed` must be a positive number, but it is -1\.0\.$"),
        ({"speed": float("nan")}, r"^Argument `speed` must be a positive number, but it is nan\.$"),
    ],
)
def test_a_film_that_cannot_be_made_is_refused_in_a_sentence(options, sentence, ball_trajectory):
    with pytest.raises(ValueError, match=sentence):
        plot.animate(ball_trajectory, **({"path": "film.gif"} | options))


def test_a_film_of_nothing_is_refused_in_a_sentence(hopeless_trajectory, tmp_path):
    with pytest.raises(ValueError, match=r"^Argument `trajectory` must have a finite state to show"):
        plot.animate(hopeless_trajectory, tmp_path / "film.gif")
    assert list(tmp_path.iterdir()) == []


def test_each_frame_shows_the_nearest_saved_time():
    times = np.array([0.0, 1.0, 1.5, 4.0])
    np.testing.assert_array_equal(frames(times, 0.5), [0, 0, 1, 2, 2, 2, 3, 3, 3])
    np.testing.assert_array_equal(frames(times, 4.0), [0, 3])
    np.testing.assert_array_equal(frames(times[:1], 0.1), [0])


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
