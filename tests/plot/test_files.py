"""The files of figures, and the scenes of animations."""

import matplotlib.image
import numpy as np
import pytest

from jaxball.files.results import OutputError
from jaxball.plot import report
from jaxball.plot.files import check_others, run_mark, save_figure, scenario_mark
from jaxball.plot.record import record
from jaxball.plot.scene import scene
from tests.plot.geometry import overlaps
from tests.support.sentences import refuses

QUANTITIES = [
    "configuration",
    "body_paths",
    "space_paths",
    "attitude",
    "angular_velocity",
    "centre_path",
    "centre_velocity",
    "energies",
    "power",
    "contact_force",
    "friction_ratio",
]


def ink(path):
    """The share of pixels that are not white."""
    return np.mean(np.any(matplotlib.image.imread(path)[..., :3] < 0.98, axis=-1))


@pytest.mark.thorough
def test_all_figures_of_the_disk(disk_trajectory, tmp_path):
    paths = disk_trajectory.save_figures(tmp_path / "new" / "folder")
    assert [path.name for path in paths] == [
        f"disk_{name}.png" for name in ["acceleration", "mass_angles", *QUANTITIES]
    ]
    for path in paths:
        assert 0.005 < ink(path) < 0.3, path


@pytest.mark.slow
def test_a_ball_without_masses_has_no_figure_of_a_dot(bare_trajectory, thrown_trajectory, tmp_path):
    """In the body, the centre of mass of a shell stays where it is; in space it does where it is the centre."""
    for run, without in (
        (bare_trajectory, {"body_paths"}),
        (thrown_trajectory, {"body_paths", "space_paths", "configuration"}),
    ):
        names = {path.stem.removeprefix("ball_") for path in run.save_figures(tmp_path, replace=True)}
        assert names & {"acceleration", "mass_angles", *QUANTITIES} == set(QUANTITIES) - without


@pytest.mark.thorough
def test_figures_of_another_run_stay(disk_trajectory, ball_trajectory, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "STANDARD", report.STANDARD[:3])
    first = disk_trajectory.save_figures(tmp_path, name="my run")
    assert {path.name.partition("_")[0] for path in first} == {"my-run"}
    kept = {path: path.read_bytes() for path in first}
    assert disk_trajectory.save_figures(tmp_path, name="my run") == first
    with refuses(OutputError):
        ball_trajectory.save_figures(tmp_path, name="my run")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == kept
    ball_trajectory.save_figures(tmp_path, name="my run", replace=True)
    assert all(path.read_bytes() != kept[path] for path in first)


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", ["png", "pdf", "svg"])
def test_a_file_says_of_which_run_it_is_in_every_format(suffix, ball_trajectory, tmp_path):
    path = tmp_path / f"figure.{suffix}"
    save_figure(ball_trajectory.plot("energies"), path, run_mark(ball_trajectory))
    check_others([path], run_mark(ball_trajectory), "")
    with pytest.raises(OutputError):
        check_others([path], scenario_mark("another"), "")


@pytest.mark.thorough
def test_text_of_pdf_is_truetype_and_that_of_svg_is_text_if_asked_for(ball_trajectory, tmp_path):
    ax = ball_trajectory.plot("energies")
    for name in ("figure.pdf", "figure.svg"):
        save_figure(ax, tmp_path / name)
    pdf, outlines = (tmp_path / "figure.pdf").read_bytes(), (tmp_path / "figure.svg").read_text()
    assert b"/Type3" not in pdf
    assert b"/CIDFontType2" in pdf
    save_figure(ax, tmp_path / "text.svg", svg_text=True)
    text = (tmp_path / "text.svg").read_text()
    assert ("<text" in outlines, "<text" in text) == (False, True)


@pytest.mark.thorough
def test_the_overview_is_one_page_of_six_panels(ball_trajectory, tmp_path):
    figure = ball_trajectory.plot()
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
