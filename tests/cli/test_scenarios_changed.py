"""Scenarios changed on the command line, read from standard input, and what is said of their runs."""

import io
import json

import numpy as np
import pytest

from jaxball import ScenarioError, load_run
from jaxball.cli import main
from jaxball.files.scenario.paths import with_values
from jaxball.plot import report
from tests.scenario.documents import BALL, DISK
from tests.support.commands import refuses_command
from tests.support.sentences import refuses, said


@pytest.fixture(autouse=True)
def folder(command_folder):
    (command_folder / "disk.toml").write_text(DISK)
    return command_folder


@pytest.mark.long
def test_values_are_set_and_standard_input_is_read(folder, monkeypatch, capsys):
    """In one run: the scenario from -, three changes, another end, and JSON alone on standard output."""
    monkeypatch.setattr("sys.stdin", io.StringIO(DISK))
    changes = ["--set", "body.mass=2", "--set", "masses[0].mass=.3", "--set", "title=heavier"]
    assert main(["simulate", "-", *changes, "--end", "1", "--out", "run.nc", "--json", "-"]) == 0
    captured = capsys.readouterr()
    content = json.loads(captured.out)
    said(captured.err)
    assert (content["ok"], content["reached"], content["title"]) == (True, 1.0, "heavier")
    run = load_run(folder / "run.nc")
    assert float(run.system.mass) == 2.0
    assert float(run.system.point_masses[0].mass) == 0.3
    assert run.times.tolist() == np.linspace(0.0, 1.0, 5).tolist()
    assert content["state"]["phi"] == float(run.state.phi[-1])

    monkeypatch.setattr(report, "STANDARD", report.STANDARD[-4:])
    assert main(["plot", "run.nc", "--out", "figures", "--format", "svg", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    drawn = sorted(path.name for path in (folder / "figures").iterdir())
    assert "run_energies.svg" in drawn
    assert all(name.endswith(".svg") for name in drawn)


@pytest.mark.thorough
def test_a_failed_run_is_failed_in_json_too(folder, capsys):
    assert main(["simulate", "disk.toml", "--set", "solve.max_steps=3", "--quiet", "--json", "run.json"]) == 3
    assert capsys.readouterr().out == ""
    content = json.loads((folder / "run.json").read_text())
    assert (content["ok"], content["status"]) == (False, "MAX_STEPS")
    assert content["state"]["phi"] is None


@pytest.mark.parametrize(
    ("change", "path", "value"),
    [
        ("a.b=2", ("a", "b"), 2),
        ("a.b=-.5", ("a", "b"), -0.5),
        ("a.b=1e-3", ("a", "b"), 1e-3),
        ("a.list[1]=7", ("a", "list"), [1, 7]),
        ("items[0].x=true", ("items",), [{"x": True}]),
        ("new.kind=gauss16", ("new", "kind"), "gauss16"),
        ('a.b="two words"', ("a", "b"), "two words"),
        ("a.list=[1, 0, 0]", ("a", "list"), [1, 0, 0]),
    ],
)
def test_a_change_is_a_path_and_a_value(change, path, value):
    document = {"a": {"b": 1, "list": [1, 2]}, "items": [{}]}
    changed = with_values(document, [change])
    for step in path:
        changed = changed[step]
    assert changed == value
    assert type(changed) is type(value)
    assert document == {"a": {"b": 1, "list": [1, 2]}, "items": [{}]}


@pytest.mark.parametrize(
    ("change", "left"),
    [
        ("a.b=", {"a": {"list": [1, 2]}, "items": [{"x": 1}, {}]}),
        ("a.list[0]= ", {"a": {"b": 1, "list": [2]}, "items": [{"x": 1}, {}]}),
        ("items[0].x=", {"a": {"b": 1, "list": [1, 2]}, "items": [{}, {}]}),
        ("items[0]=", {"a": {"b": 1, "list": [1, 2]}, "items": [{}]}),
        ("a=", {"items": [{"x": 1}, {}]}),
    ],
)
def test_a_change_without_a_value_takes_away(change, left):
    document = {"a": {"b": 1, "list": [1, 2]}, "items": [{"x": 1}, {}]}
    assert with_values(document, [change]) == left
    assert document["items"] == [{"x": 1}, {}]


@pytest.mark.thorough
def test_one_key_takes_the_place_of_another(folder, capsys):
    """`time.saves` and `time.step` exclude each other."""
    assert main(["validate", "disk.toml"]) == 0
    step = ["--set", "time.step=0.5", "--end", "1", "--quiet"]
    assert main(["simulate", "disk.toml", *step]) == 2
    assert main(["simulate", "disk.toml", "--set", "time.saves=", *step, "--out", "run.npz"]) == 0
    assert load_run(folder / "run.npz").times.tolist() == [0.0, 0.5, 1.0]


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ("body.mass", "body.mass"),
        ("=2", "A change"),
        ("body..mass=2", "A change"),
        ("masses[7].mass=2", "masses[7].mass"),
        ("body[0]=2", "body"),
        ("title.x=2", "title"),
        ("initial.Omega[1]=2", "initial.Omega"),
        ("body.mas=", "body.mas"),
        ("masses[1]=", "masses[0]"),
        ("body.mass.x=", "body.mass.x"),
        ("solve.rtol=", "solve.rtol"),
        ("body.mass=two words", "body.mass"),
    ],
)
def test_a_change_that_cannot_be(change, named):
    with refuses(ScenarioError, named):
        with_values({"title": "", "body": {"mass": 1}, "masses": [{}]}, [change])


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--set", "body.mas=2"], "body.mas"),
        (["--set", "time.at=[0, 1]", "--end", "5"], "--end"),
        (["--plot", "page.pdf"], "--plot"),
        (["--plot-format", "pdf"], "--plot-format"),
        (["--animate", "film.gif", "--fps", "60"], "--fps"),
        (["--animate", "film.gif", "--from", "1.5", "--to", "1"], "--from"),
        (["--animate", "film.gif", "--to", "3"], "--from"),
    ],
)
def test_options_that_are_refused_before_a_run(folder, capsys, arguments, named):
    refuses_command(capsys, ["simulate", "disk.toml", *arguments], named)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["none.nc", "--out", "figures"], "none.nc"),
        (["disk.toml", "--out", "figures"], "jaxball simulate disk.toml"),
        (["disk.txt", "--out", "figures"], "disk.txt"),
        (["disk.toml", "--out", "disk.toml"], "--out"),
    ],
)
def test_a_run_that_cannot_be_drawn(capsys, arguments, named):
    refuses_command(capsys, ["plot", *arguments], named)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["disk.toml", "hoop-with-backspin"])
def test_a_part_of_a_run_is_filmed(folder, scenario):
    from PIL import Image

    arguments = ["--animate", "film.gif", "--from", "0.5", "--to", "1.5", "--fps", "4", "--size", "320x180"]
    assert main(["simulate", scenario, *arguments, "--speed", "0.5"]) == 0
    with Image.open(folder / "film.gif") as film:
        assert film.size == (320, 180)
        assert film.n_frames == 9
        assert film.info["duration"] == 250


@pytest.mark.long
def test_the_solver_of_an_option_is_known_when_changes_are_checked(folder, capsys):
    """In the differential-algebraic form, which only --solver makes possible, with the end of the usual form."""
    (folder / "ball.toml").write_text(BALL)
    both = ["--set", "solve.dae=true", "--solver", "radau9"]
    ends = []
    for more in (both, []):
        assert main(["simulate", "ball.toml", "--end", "1", "--quiet", "--json", "-", *more]) == 0
        ends.append(json.loads(capsys.readouterr().out)["state"]["z"])
    np.testing.assert_allclose(*ends, atol=1e-8)
    assert main(["simulate", "ball", "--set", "solve.dae=true", "--solver", "dopri5"]) == 2
    said(capsys.readouterr().err, "--solver")
    assert main(["simulate", "ball", "--set", "solve=3", "--solver", "radau9"]) == 2
    said(capsys.readouterr().err, "solve")


@pytest.mark.parametrize("command", [["simulate"], ["verify"], ["export", "--to", "mjcf"], ["stability"]])
def test_every_problem_of_a_scenario_is_told(folder, capsys, command):
    """The sentences are those of validate, whose number is that of the mistakes made here."""
    wrong = DISK.replace("format = 1", 'format = 1\ntitel = "x"').replace("[body]", "[body]\nmas = 1\nheight = 2", 1)
    (folder / "wrong.toml").write_text(wrong)
    assert main(["validate", "wrong.toml"]) == 2
    sentences = capsys.readouterr().err.splitlines()
    assert [line.split("`")[1] for line in sentences] == ["titel", "body.mas", "body.height"]
    assert main([*command[:1], "wrong.toml", *command[1:]]) == 2
    assert capsys.readouterr().err.splitlines() == [f"jaxball: {line}" for line in sentences]


@pytest.mark.parametrize(
    ("command", "setting"),
    [
        (["chaos"], "solve.max_step=0.1"),
        (["periodic", "--period", "1"], "solve.solver=radau9"),
        (["stability"], "solve.rtol=1e-3"),
        (["export", "--to", "mjcf"], "solve.rtol=1e-3"),
    ],
)
def test_a_setting_of_the_solve_that_a_command_does_not_use_is_refused(folder, capsys, command, setting):
    assert main([command[0], "disk.toml", *command[1:], "--set", setting]) == 2
    said(capsys.readouterr().err, "--set", setting.partition("=")[0])


@pytest.mark.thorough
def test_exponents_have_the_steps_of_the_scenario(capsys):
    """It needs more than three for the first interval."""
    assert main(["chaos", "ball", "--end", "3", "--set", "solve.max_steps=3"]) == 3
    said(capsys.readouterr().err, "max_steps")
