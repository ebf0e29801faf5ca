"""Animations, read back from their files."""

import itertools
import subprocess

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from matplotlib.colors import to_rgb
from mpl_toolkits.mplot3d import proj3d
from PIL import Image

import jaxball
from jaxball.interface.output import OutputError
from jaxball.plot.animation import Canvas, frames, long_runs, palette_of
from jaxball.plot.palette import mass_colour
from jaxball.plot.record import record
from jaxball.plot.scene import scene, stage
from jaxball.plot.shapes import Placed, Setting, place
from tests.support.sentences import refuses

SIZE = (800, 600)
LARGEST, IN_ALL = 3e6, 401  # bytes of a GIF of 20 s, and its frames
A_SECOND_APART = 1.25  # how much more is different then than from one of these frames to the next
needs_ffmpeg = pytest.mark.skipif(not FFMpegWriter.isAvailable(), reason="ffmpeg is not installed")


def frames_of(path):
    """The pictures of a GIF, and how long each is shown, in milliseconds."""
    with Image.open(path) as film:
        pictures, durations = [], []
        for k in range(film.n_frames):
            film.seek(k)
            pictures.append(np.asarray(film.convert("RGB"), dtype=float))
            durations.append(film.info["duration"])
    return np.stack(pictures), durations


def picture_with_masses(trajectory, k, dpi):
    """A saved time drawn as a whole, without a background that is kept, and the pixel (column, row) of each mass."""
    figure, show = scene(trajectory, record(trajectory))
    show(k)
    for artist in figure.findobj(lambda artist: artist.get_animated()):
        artist.set_animated(False)
    canvas = Canvas(figure, dpi)
    seen = trajectory.observables
    places = np.asarray(seen.geometric_centre)[k] + np.asarray(seen.mass_positions_space)[k]
    pixels = figure.axes[0].transData.transform(places[:, [0, 2]])
    return canvas.picture().astype(float), np.column_stack([pixels[:, 0], canvas.size[1] - pixels[:, 1]])


@pytest.fixture(scope="module")
def disk_film(disk_trajectory, tmp_path_factory):
    """The paper's disk at t = 0, 1, …, 20, four of these times a second."""
    return disk_trajectory.animate(tmp_path_factory.mktemp("film") / "disk.gif", fps=4, speed=4.0, dpi=60).path


@pytest.mark.thorough
@pytest.mark.parametrize("k", [0, 20])
def test_a_gif_shows_the_first_and_the_last_pose(disk_film, disk_trajectory, k):
    pictures, _ = frames_of(disk_film)
    assert len(pictures) == 21
    drawn, masses = picture_with_masses(disk_trajectory, k, dpi=60)
    # Where two marks lie on one another the later one is seen.
    for i in (1, 2):
        column, row = np.floor(masses[i - 1]).astype(int)
        np.testing.assert_allclose(pictures[k][row, column], np.round(255 * np.array(to_rgb(mass_colour(i)))), atol=1)
    # The colours of the palette are a third of the way to white apart.
    assert np.sqrt(np.mean((pictures[k] - drawn) ** 2)) < 6
    assert np.max(np.abs(pictures[k] - drawn)) < 90


@pytest.mark.thorough
def test_what_has_moved_on_leaves_nothing_behind(disk_film):
    """Frames are drawn as changes of those before, so a mistake in one would be seen in all that follow."""
    pictures, _ = frames_of(disk_film)
    inked = np.any(pictures[20] < 128, axis=-1)
    ever_inked = np.any(pictures < 128, axis=(0, -1))
    assert np.count_nonzero(inked) < 0.6 * np.count_nonzero(ever_inked)


@pytest.mark.thorough
@pytest.mark.parametrize("fps", [7, 30])
def test_a_gif_lasts_as_long_as_it_should(disk_trajectory, tmp_path, fps):
    """Its frames last whole hundredths of a second, and so not all of them the same time."""
    path = disk_trajectory.animate(tmp_path / "disk.gif", fps, speed=float(fps), dpi=20).path
    _, durations = frames_of(path)
    assert len(durations) == 21
    assert abs(sum(durations) - 1000 * 21 / fps) <= 5
    assert max(durations) - min(durations) <= 10


@pytest.mark.long
def test_a_gif_is_small(ball_trajectory, tmp_path):
    path = ball_trajectory.animate(tmp_path / "film.gif", fps=1, size=SIZE).path
    with Image.open(path) as film:
        assert film.size == SIZE
        assert path.stat().st_size < A_SECOND_APART * LARGEST / IN_ALL * film.n_frames


@pytest.mark.thorough
def test_frames_differ_where_the_body_moves(disk_film):
    pictures, _ = frames_of(disk_film)
    for before, after in itertools.pairwise(pictures):
        assert np.any(before != after)


def test_each_frame_shows_the_nearest_saved_time():
    times = np.array([0.0, 1.0, 1.5, 4.0])
    np.testing.assert_array_equal(frames(times, 0.5), [0, 0, 1, 2, 2, 2, 3, 3, 3])
    np.testing.assert_array_equal(frames(times, 4.0), [0, 3])
    np.testing.assert_array_equal(frames(times[:1], 0.1), [0])


@pytest.mark.thorough
def test_a_picture_is_the_one_that_is_drawn_at_once(ball_trajectory):
    """Drawing only what moves gives what drawing everything does."""
    at_once, apart = (scene(ball_trajectory, record(ball_trajectory)) for _ in range(2))
    apart.show(0)
    canvas = Canvas(apart.figure, 60)
    for made in (at_once, apart):
        made.show(12)
    for artist in at_once.figure.findobj(lambda artist: artist.get_animated()):
        artist.set_animated(False)
    np.testing.assert_array_equal(canvas.picture(), Canvas(at_once.figure, 60).picture())


def test_progress_counts_the_frames(disk_trajectory, tmp_path):
    told = []
    disk_trajectory.animate(tmp_path / "film.gif", 1, speed=5.0, dpi=20, progress=lambda *done: told.append(done))
    assert told == [(1, 5), (2, 5), (3, 5), (4, 5), (5, 5)]


@pytest.mark.parametrize("suffix", [".gif", pytest.param(".mp4", marks=needs_ffmpeg)])
def test_a_film_that_was_interrupted_is_not_left(disk_trajectory, tmp_path, suffix):
    def interrupt(done, frames):
        if done == 2:
            raise KeyboardInterrupt

    path = tmp_path / f"film{suffix}"
    options = {"fps": 1, "speed": 5.0, "dpi": 20, "progress": interrupt}
    with pytest.raises(KeyboardInterrupt):
        disk_trajectory.animate(path, **options)
    assert list(tmp_path.iterdir()) == []
    path.write_text("an older one")
    with pytest.raises(KeyboardInterrupt):
        disk_trajectory.animate(path, **options)
    assert path.read_text() == "an older one"
    assert list(tmp_path.iterdir()) == [path]


@needs_ffmpeg
def test_an_mp4_shows_every_frame_also_of_an_odd_size(disk_trajectory, tmp_path):
    path = disk_trajectory.animate(tmp_path / "film.mp4", 10, speed=10.0, size=(401, 301)).path
    command = [
        FFMpegWriter.bin_path(),
        "-loglevel",
        "error",
        "-i",
        str(path),
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-",
    ]
    pixels = np.frombuffer(subprocess.run(command, check=True, capture_output=True).stdout, dtype=np.uint8)
    pictures = pixels.reshape(-1, 302, 402, 3).astype(float)
    assert len(pictures) == 21
    assert np.all(pictures[:, -1] > 250)
    assert np.mean(np.abs(pictures[20] - pictures[0])) > 1


@needs_ffmpeg
def test_an_mp4_where_no_suffix_is_given(disk_trajectory, tmp_path):
    path = disk_trajectory.animate(tmp_path / "disk", fps=1, speed=10.0, dpi=40).path
    assert path == tmp_path / "disk.mp4"
    assert path.read_bytes()[4:8] == b"ftyp"


def test_an_ffmpeg_that_fails_is_quoted(disk_trajectory, tmp_path, monkeypatch):
    broken = tmp_path / "ffmpeg"
    broken.write_text("#!/bin/sh\necho \"Unknown encoder 'libx264'\" >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(FFMpegWriter, "bin_path", classmethod(lambda cls: str(broken)))
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: True))
    with refuses(OutputError, "ffmpeg"):
        disk_trajectory.animate(tmp_path / "film.mp4", dpi=40)
    assert list(tmp_path.iterdir()) == [broken]


@pytest.mark.thorough
def test_without_ffmpeg_a_gif(bare_trajectory, tmp_path, monkeypatch):
    monkeypatch.setattr(FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    path = bare_trajectory.animate(tmp_path / "bare", fps=1, dpi=30).path
    assert path == tmp_path / "bare.gif"
    with refuses(ValueError, "path"):
        bare_trajectory.animate(tmp_path / "bare.mp4")


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"path": "film.avi"}, "path"),
        ({"fps": 0}, "fps"),
        ({"speed": -1.0}, "speed"),
        ({"speed": float("nan")}, "speed"),
    ],
)
def test_a_film_that_cannot_be_made_is_refused_in_a_sentence(options, named, ball_trajectory):
    with refuses(ValueError, named):
        ball_trajectory.animate(**({"path": "film.gif"} | options))


def test_a_film_of_nothing_is_refused_in_a_sentence(hopeless_trajectory, tmp_path):
    with refuses(ValueError, "trajectory"):
        hopeless_trajectory.animate(tmp_path / "film.gif")
    assert list(tmp_path.iterdir()) == []


def test_gaps_between_changes_are_long_or_none():
    same = np.array([[1, 1, 0, 1], [1, 1, 0, 0], [1, 0, 1, 1]], dtype=bool)
    kept = np.array([[0, 0, 0, 1], [1, 1, 0, 0], [0, 0, 0, 0]], dtype=bool)
    np.testing.assert_array_equal(long_runs(same, 3), kept)
    np.testing.assert_array_equal(long_runs(same, 1), same)


def test_a_palette_has_white_first_and_every_colour_as_it_is():
    palette = palette_of(["#0072B2", "black", "#0072B2", "0.5"]).tolist()
    assert palette[0] == [255, 255, 255]
    assert [0x00, 0x72, 0xB2] in palette
    assert [0, 0, 0] in palette
    assert len({tuple(colour) for colour in palette}) == len(palette)


@pytest.mark.parametrize(("t", "k"), [(7.3, 7), (None, 20)])
def test_a_snapshot_shows_the_nearest_saved_time_or_the_last(disk_trajectory, tmp_path, t, k):
    path = tmp_path / "disk.png"
    disk_trajectory.snapshot(t).savefig(path, dpi=60)
    shown = np.asarray(Image.open(path).convert("RGB"), dtype=float)
    np.testing.assert_allclose(shown, picture_with_masses(disk_trajectory, k, dpi=60)[0], atol=1)


@pytest.mark.parametrize("heading", [0.0, 1.1, 2.5, -2.0])
@pytest.mark.parametrize("width", [0.0, 0.3])
def test_a_path_on_a_level_plane_leads_to_the_right_of_the_page(heading, width):
    """The camera's right is (−sin a, cos a), and its view is across: a bent path is as deep as it is wide."""
    s = np.linspace(-1.0, 1.0, 41)
    across = width * (s**2 - np.mean(s**2))
    c, n = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    path = np.array([3.0, -2.0, 0.0]) + np.column_stack([s[:, None] * c + across[:, None] * n, np.zeros(41)])
    setting = Setting(np.eye(3), np.zeros((41, 3)), None, np.zeros(3))
    placed = Placed(s, setting, np.zeros((41, 3, 3)), path, np.zeros((41, 0, 3)), path, path, [])
    a = np.deg2rad(placed.azimuth(-60.0))
    np.testing.assert_allclose([-np.sin(a), np.cos(a)], c, atol=1e-12)


def test_a_slope_is_seen_from_beside_its_descent():
    """As before, whatever the path: the view is 60° from the direction of steepest descent."""
    tilted = jaxball.Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=jaxball.Ground(angle=0.2))
    run = jaxball.simulate(tilted, [0.0, 1.0, 2.0], jaxball.BallState(Omega=(0.0, 0.5, 0.1)))
    placed = place(run, record(run))
    assert placed.azimuth(-60.0) == pytest.approx(placed.setting.downhill - 60.0)


@pytest.mark.parametrize("size", [(10.0, 6.0, 1.0), (20.0, 1.0, 1.0), (1.0, 10.0, 1.0), (1.0, 1.0, 10.0)])
@pytest.mark.parametrize("azimuth", [-60.0, 0.0, 45.0])
def test_nothing_of_a_long_scene_is_cut_off(size, azimuth):
    """The Axes clip what is outside of them, and the figure what is outside of it."""
    corners = np.array([[x, y, z] for x in (0.0, size[0]) for y in (0.0, size[1]) for z in (0.0, size[2])])
    figure, ax = stage(corners, azimuth)
    figure.canvas.draw()
    x, y, _ = proj3d.proj_transform(*corners.T, ax.get_proj())
    places = ax.transData.transform(np.column_stack([x, y]))
    for box in (ax.bbox, figure.bbox):
        assert np.all((places >= box.min - 1e-6) & (places <= box.max + 1e-6))
