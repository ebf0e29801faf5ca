"""Views from the command line: of a run that is made, of a saved one, and of one that failed."""

import numpy as np
import pytest

from jaxball.cli import main
from jaxball.interface.output import MARK
from jaxball.studies.design import load_result
from jaxball.studies.sweep import open_store
from tests.scenario.documents import DISK
from tests.support.pages import arrays_of, document_in, unpacked
from tests.support.sentences import said


@pytest.fixture(autouse=True)
def folder(command_folder):
    (command_folder / "disk.toml").write_text(DISK)
    return command_folder


@pytest.mark.thorough
def test_a_saved_run_has_the_view_of_the_run_itself(folder, capsys):
    arguments = ["disk.toml", "--set", 'title="<b>a test"', "--end", "1"]
    assert main(["simulate", *arguments, "--out", "run.nc", "--view", "run.html"]) == 0
    assert "written: run.nc, run.html" in capsys.readouterr().out
    assert main(["view", "run.nc", "--out", "again.html", "--friction", "0.4", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    first, again = (document_in((folder / name).read_text()) for name in ("run.html", "again.html"))
    assert first["title"] == "<b>a test"
    assert arrays_of(first)["time"].shape == (5,)
    assert again == first | {"friction": 0.4}

    assert main(["view", "run.nc", "--out", "again.html"]) == 0
    assert "written: again.html" in capsys.readouterr().out
    assert document_in((folder / "again.html").read_text()) == first


@pytest.mark.thorough
def test_a_run_that_failed_is_shown_and_marked(folder, capsys):
    failing = ["simulate", "disk.toml", "--set", "solve.max_steps=3", "--view", "run.html"]
    assert main(failing) == 3
    said(capsys.readouterr().err, "max_steps")
    document = document_in((folder / "run.html").read_text())
    assert document["ok"] is False
    assert "max_steps" in document["message"]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["simulate", "disk.toml", "--view", "notes.html"], "--view"),
        (["simulate", "disk.toml", "--view", "run.txt"], "--view"),
        (["view", "disk.toml", "--out", "run.html"], "jaxball simulate disk.toml"),
        (["view", "notes.nc", "--out", "run.html"], "notes.nc"),
        (["view", "notes.nc", "--out", "notes.html"], "--out"),
        (["view", "folder.nc", "--out", "run.html"], "folder.nc"),
        (["view", "notes.nc", "--rows", "1", "--out", "run.html"], "--rows"),
        (["view", "notes.nc", "--colour", "x", "--out", "run.html"], "--colour"),
        (["view", "notes.nc", "--out", "folder.html"], "--out"),
    ],
)
def test_what_is_refused_leaves_every_file_as_it_was(folder, capsys, arguments, named):
    for name in ("notes.html", "notes.nc"):
        (folder / name).write_text(MARK.upper())
    for name in ("folder.nc", "folder.html"):
        (folder / name).mkdir()
    before = sorted(folder.iterdir())
    assert main(arguments) == 2
    captured = capsys.readouterr()
    said(captured.err, named)
    assert captured.out == ""
    assert sorted(folder.iterdir()) == before
    assert (folder / "notes.html").read_text() == MARK.upper()


@pytest.mark.thorough
@pytest.mark.parametrize(("scenario", "kind"), [("suslov", "rigid"), ("vakonomic-particle", "particle")])
def test_classical_systems_have_a_view(folder, scenario, kind):
    assert main(["simulate", scenario, "--end", "0.5", "--view", "run.html", "--quiet"]) == 0
    document = document_in((folder / "run.html").read_text())
    assert [body["body"] for body in document["bodies"]] == [kind]
    assert arrays_of(document)["time"][-1] == 0.5
    assert document["floor"] is None


@pytest.mark.thorough
def test_a_saved_run_of_a_classical_system_has_a_view_without_friction(folder, capsys):
    assert main(["simulate", "free-rigid-body", "--end", "1", "--out", "top.nc", "--view", "top.html", "--quiet"]) == 0
    assert main(["view", "top.nc", "--out", "again.html", "--quiet"]) == 0
    first, again = (document_in((folder / name).read_text()) for name in ("top.html", "again.html"))
    assert first == again
    assert main(["view", "top.nc", "--out", "third.html", "--friction", "0.3"]) == 2
    said(capsys.readouterr().err, "--friction", "free rigid body")
    assert not (folder / "third.html").exists()


PROBLEM = """
format = 1
title = "<b>a design"

[scenario]
%s

[[scenario.masses]]
mass = 0.5
rail = { kind = "circle", radius = 0.9 }
schedule = { kind = "constant-rate", theta = 0.7, rate = 0.2 }

[[variables]]
path = "masses[0].schedule.rate"
start = 0.3

[[objectives]]
kind = "follow-curve"
curve = { kind = "through", points = [0.0, 1.0] }
"""
SCENARIO = """
format = 1
kind = "disk"
body = { mass = 1.0, radius = 1.0, inertia = 1.0, gravity = 1.0 }
time = { start = 0.0, end = 2.0, saves = 5 }
"""


OBSTACLES = """
[[objectives]]
kind = "avoid-obstacles"
centres = [3.0]
radii = [0.5]

[[constraints]]
kind = "clear-of-obstacles"
centres = [-4.0, 6.0]
radii = [1.0, 0.25]
"""
CONTROL = """
[control]
place = 1.0
"""


@pytest.mark.thorough
@pytest.mark.parametrize("control", ["", CONTROL])
def test_obstacles_of_a_design_are_in_its_view(folder, control):
    """Those of objectives and of constraints, of both kinds of problem."""
    problem = PROBLEM % SCENARIO
    if control:
        problem = problem.partition("[[variables]]")[0] + '[[objectives]]\nkind = "acceleration-effort"\n'
    result = folder / "result"
    result.mkdir()
    (result / "problem.toml").write_text(problem + OBSTACLES + control)
    (result / "design.toml").write_text(DISK)
    assert main(["view", "result", "--out", "design.html"]) == 0
    document = document_in((folder / "design.html").read_text())
    assert document["obstacles"] == [[3.0, 0.0, 0.5], [-4.0, 0.0, 1.0], [6.0, 0.0, 0.25]]


@pytest.mark.thorough
def test_a_design_is_shown_before_and_after_with_the_path_that_is_wanted(folder, capsys):
    """Both are known in closed form: the masses' angles are θ + rate t, with the start of the variable and what was
    found.
    """
    result = folder / "result"
    result.mkdir()
    (result / "problem.toml").write_text(PROBLEM % SCENARIO)
    (result / "design.toml").write_text(DISK.replace("rate = 0.2", "rate = -0.4"))
    assert main(["view", "result", "--out", "design.html", "--friction", "0.4"]) == 0
    assert "written: design.html" in capsys.readouterr().out
    document = document_in((folder / "design.html").read_text())
    assert (document["title"], document["friction"]) == ("<b>a design", 0.4)
    assert [body["name"] for body in document["bodies"]] == ["before", "after"]
    for body, rate in enumerate((0.3, -0.4)):
        arrays = arrays_of(document, body)
        np.testing.assert_allclose(arrays["mass_angles"][:, 0], 0.7 + rate * arrays["time"], rtol=1e-6)
    wanted = unpacked(document["arrays"][document["wanted"]])
    np.testing.assert_allclose(wanted[[0, -1]], [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0]], atol=1e-6)

    (result / "design.toml").write_text(DISK + "\n[ground]\nangle = 0.1\n")
    assert main(["view", "result", "--out", "other.html"]) == 2
    said(capsys.readouterr().err, "after")

    (result / "problem.toml").unlink()
    assert main(["view", "result", "--out", "other.html"]) == 2
    said(capsys.readouterr().err, "result")
    (result / "problem.toml").write_text("no document")
    assert main(["view", "result", "--out", "other.html"]) == 2
    said(capsys.readouterr().err)
    assert not (folder / "other.html").exists()


def test_a_problem_of_optimal_control_begins_with_its_scenario(folder):
    problem = (PROBLEM % SCENARIO).partition("[[variables]]")[0]
    objective = '[[objectives]]\nkind = "acceleration-effort"\n'
    (folder / "problem.toml").write_text(f"{problem}{objective}[control]\nplace = 1.0\n")
    (folder / "design.toml").write_text(DISK)
    result = load_result(folder)
    assert (result.title, result.wanted) == ("<b>a design", None)
    assert float(result.before.system.groups[0].motion.schedule.rate[0]) == 0.2


@pytest.fixture
def store(folder):
    """Disks of which one cannot be, and one is not done."""
    (folder / "study.toml").write_text(
        'format = 1\ntitle = "<b>a study"\nscenario = "disk.toml"\nchunk = 3\n'
        '[[axes]]\npath = "body.mass"\nvalues = [0.5, -1.0, 2.0, 3.0]\n'
    )
    assert main(["sweep", "study.toml", "--out", "study.zarr", "--shard", "1/2"]) == 0
    return folder


@pytest.mark.thorough
def test_rows_of_a_sweep_are_shown_in_the_colours_of_a_number(store, capsys):
    assert main(["view", "study.zarr", "--rows", "2,0", "--out", "rows.html", "--quiet"]) == 0
    document = document_in((store / "rows.html").read_text())
    assert document["title"] == "<b>a study"
    assert [(body["name"], body["value"]) for body in document["bodies"]] == [("row 2", 2.0), ("row 0", 0.5)]
    assert [document["scale"][key] for key in ("name", "low", "high")] == ["m₀ (mass)", 0.5, 2.0]
    store_ends = open_store("study.zarr").dataset()["phi"].values[[2, 0]]
    for body, phi in enumerate(store_ends):
        z = arrays_of(document, body)["centre"][-1, 0]  # = −r φ
        assert z == pytest.approx(-phi, abs=1e-6)

    assert main(["view", "study.zarr", "--rows", "2,0", "--colour", "phi", "--out", "rows.html", "--quiet"]) == 0
    document = document_in((store / "rows.html").read_text())
    assert [body["value"] for body in document["bodies"]] == store_ends.tolist()

    capsys.readouterr()
    for arguments, named in (
        (["--rows", "0,9"], "study.zarr"),
        (["--rows", "0,3"], "study.zarr"),
        (["--rows", "1"], "Row 1"),
        (["--rows", "0", "--colour", "<b>"], "<b>"),
        ([], "--rows"),
    ):
        assert main(["view", "study.zarr", *arguments, "--out", "other.html"]) == 2
        said(capsys.readouterr().err, named)
    assert not (store / "other.html").exists()
