"""What objects show in a notebook."""

import base64
import inspect
import io
import os
import re
import xml.etree.ElementTree
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

import jaxball
from jaxball import Ball, BallState, Disk, DiskState, load_scenario, simulate
from jaxball.interface.names import public_packages
from jaxball.interface.printing import SIZE, as_html, sketch_of
from jaxball.studies.design.optimal_control.solution import Resimulated
from jaxball.studies.design.optimal_control.solve import Controlled
from jaxball.studies.design.result import Result
from jaxball.studies.design.search.verify import GradientCheck
from jaxball.studies.sweep.axes import Listed
from jaxball.studies.sweep.study import Study

ROLLING = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4))


def parse(html):
    return xml.etree.ElementTree.fromstring(html)


def test_text_is_escaped_and_its_headline_is_bold():
    page = parse(as_html("a < b & c\n  <script>"))
    assert page.find("pre/b").text == "a < b & c"
    assert "".join(page.itertext()) == "a < b & c\n  <script>"


def test_the_path_of_a_ball_is_beside_its_text():
    run = simulate(ROLLING, [0.0, 1.0, 2.0], BallState(Omega=(0.0, 1.0, 0.0)))
    page = parse(run._repr_html_())
    assert "".join(page.find("pre").itertext()) == repr(run)
    points = page.find("svg/polyline").get("points").split()
    assert len(points) == 3
    x = [float(point.split(",")[0]) for point in points]
    assert x[1] - x[0] == pytest.approx(x[2] - x[1], abs=0.1)  # it rolls evenly


def test_a_path_keeps_its_proportions():
    turn = np.linspace(0.0, 2 * np.pi, 1000)
    drawn = parse(sketch_of(np.stack([3 * np.cos(turn), np.sin(turn)], axis=1), "an ellipse"))
    points = np.array([[float(x) for x in point.split(",")] for point in drawn.find("polyline").get("points").split()])
    assert len(points) <= 500
    assert np.divide(*np.ptp(points, axis=0)) == pytest.approx(3.0, rel=0.01)
    assert int(drawn.get("width")) == SIZE


def test_a_ball_at_rest_has_no_path():
    assert "<svg" not in simulate(ROLLING, [0.0, 1.0], BallState())._repr_html_()
    assert sketch_of(np.full((3, 2), np.nan), "nothing") == ""


def test_a_batch_and_other_objects_show_their_text():
    disk = Disk(mass=1.0, inertia=0.5)
    study = Study("speeds", {}, (Listed("state.phidot", (0.0, 1.0, 2.0)),))
    for thing in (disk, DiskState(), load_scenario("ball"), study):
        assert "".join(parse(thing._repr_html_()).itertext()).strip() == repr(thing).strip()
    assert repr(study) == "Study 'speeds': 3 rows\n  state.phidot: 3 points"


def test_whatever_prints_itself_shows_itself():
    """Classes whose text is jaxball's own have it in notebooks too."""
    found = (getattr(package, name) for package in public_packages(jaxball) for name in package.__all__)
    classes = {one for one in found if inspect.isclass(one)}
    written = {kind: getattr(inspect.unwrap(kind.__repr__), "__code__", None) for kind in classes}
    source = str(Path(jaxball.__file__).parent)
    own = {kind for kind, code in written.items() if code and code.co_filename.startswith(source)}
    assert len(own) > 100
    assert {kind.__name__ for kind in own if not hasattr(kind, "_repr_html_")} == set()


def controlled(**seen):
    """A solution whose simulation is as given; nothing in it is solved."""
    values = dict.fromkeys(Resimulated._fields, 0.0) | {"violations": {}} | seen
    solution = SimpleNamespace(errors=np.zeros(12))
    return Controlled(solution, solution, (), 0.3, Resimulated(**values), 1e-6, 1e-6, 1.0)


def test_designs_show_a_few_lines():
    """Neither the arrays of a solution nor two whole scenarios."""
    start, end = load_scenario("ball"), load_scenario("disk")
    result = Result("A title", start, end, np.zeros((7, 2)), ((np.zeros(2), 1.0),))
    check = GradientCheck(1.0, 1.0, (1e-3,), (1.0,))
    for thing in (result, check, controlled(apart=1e-9), controlled(violations={"friction": 0.5})):
        assert "".join(parse(thing._repr_html_()).itertext()).strip() == repr(thing).strip()
    assert repr(result).splitlines() == [
        "Result of a design: A title",
        f"  before: {repr(start).splitlines()[0]}",
        f"  after: {repr(end).splitlines()[0]}",
        "  a curve to follow, 7 points",
        "  1 disc to avoid",
    ]
    assert repr(controlled(apart=1e-9)).splitlines() == [
        "Optimal control, confirmed: a path in 12 intervals",
        "  its simulation is up to 1e-09 radii away, and misses its end by 0 radii",
        "  the least curvature is 0.3: a strict minimum",
    ]
    assert repr(controlled(violations={"friction": 0.5})).splitlines()[-1] == "  friction is violated by 0.5"


CELLS = {
    "run": """
import jax
jax.config.update("jax_enable_x64", True)
import jaxball
disk = jaxball.Disk(mass=1.0, inertia=0.5)
run = jaxball.simulate(disk, [0.0, 1.0, 2.0], jaxball.DiskState(phidot=-1.0))
""",
    "overview": "run.plot()",
    "snapshot": "run.snapshot()",
    "one panel": "run.plot('centre_path')",
    "with pyplot": "import matplotlib.pyplot as plt\nrun.plot('energies')",
    "animation": "run.animate(fps=2, dpi=20)",
}


@pytest.fixture(scope="module")
def shown():
    """What an executed notebook shows under each cell, by the kinds of its data."""
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in CELLS.values()])
    here = {"PYTHONPATH": str(Path(jaxball.__file__).parents[1])}
    nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3").execute(env=os.environ | here)
    outputs = [[output["data"] for output in cell.outputs] for cell in notebook.cells]
    return dict(zip(CELLS, outputs, strict=True))


@pytest.mark.thorough
@pytest.mark.parametrize("cell", ["overview", "snapshot", "one panel", "with pyplot"])
def test_a_notebook_shows_figures_without_a_setting(shown, cell):
    """One picture each, whose pixels are white and other colours; a figure that is not drawn would be white alone."""
    (data,) = shown[cell]
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(data["image/png"]))).convert("L"))
    assert min(picture.shape) > 200
    assert np.mean(picture == 255) > 0.5
    assert np.mean(picture < 128) > 1e-3


@pytest.mark.thorough
def test_a_notebook_plays_animations(shown):
    """As a GIF or an MP4, as the machine has ffmpeg or not; a GIF has a frame for each half of a second."""
    (data,) = shown["animation"]
    kind, content = re.search(r'src="data:(image/gif|video/mp4);base64,([^"]*)"', data["text/html"]).groups()
    film = base64.b64decode(content)
    if kind == "image/gif":
        assert Image.open(io.BytesIO(film)).n_frames == 5
    else:
        assert film[4:8] == b"ftyp"


def test_an_animation_is_shown_as_it_was_saved(tmp_path):
    run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    film = run.animate(fps=1, dpi=20)
    assert film.path is None
    assert repr(film) == "Animation of a disk from t = 0 to t = 2"
    path = film.save(tmp_path / "film.gif")
    assert film.path == path
    assert base64.b64encode(path.read_bytes()).decode() in film._repr_html_()
