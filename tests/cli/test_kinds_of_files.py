"""What each command says of a file of another kind, and that it names the command that runs it."""

import io
import shlex
from pathlib import Path

import pytest

from jaxball.cli import main
from tests.scenario.documents import DISK

EXAMPLES = Path(__file__).parents[2] / "examples"
STUDY = 'format = 1\nscenario = "disk.toml"\n[[axes]]\npath = "body.mass"\nvalues = [1.0, 2.0]\n'
OF_SCENARIOS = (
    "simulate {}",
    "track {}",
    "verify disk.toml {}",
    "chaos {}",
    "stability {}",
    "periodic {} --period 1",
    "export {} --to mjcf",
)
OF_RUNS = ("view {} --out run.html", "plot {} --out figures", "import {}")
OF_STUDIES, OF_PROBLEMS = "sweep {} --out new.zarr", "design {} --out new"


@pytest.fixture(autouse=True)
def folder(command_folder):
    """A scenario, a study and a problem."""
    (command_folder / "disk.toml").write_text(DISK)
    (command_folder / "a study.toml").write_text(STUDY)
    for name in ("problem_rail_shape_circles.toml", "problem_disk_control.toml"):
        (command_folder / name).write_text((EXAMPLES / name).read_text())
    return command_folder


def _refusal(capsys, command, file):
    assert main(shlex.split(command.format(shlex.quote(file)))) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err


@pytest.mark.parametrize("command", [*OF_SCENARIOS, *OF_RUNS, OF_PROBLEMS])
def test_a_study_is_one_for_sweep(command, capsys):
    sentence = "jaxball: a study.toml is a study; run it with `jaxball sweep 'a study.toml' --out STORE`.\n"
    assert _refusal(capsys, command, "a study.toml") == sentence


@pytest.mark.parametrize("command", [*OF_RUNS, OF_PROBLEMS, OF_STUDIES])
def test_a_scenario_is_one_for_simulate(command, capsys):
    sentence = "jaxball: disk.toml is a scenario; run it with `jaxball simulate disk.toml`.\n"
    assert _refusal(capsys, command, "disk.toml") == sentence


@pytest.mark.parametrize("command", [*OF_SCENARIOS, *OF_RUNS, OF_STUDIES])
@pytest.mark.parametrize(
    ("file", "what"),
    [
        ("problem_rail_shape_circles.toml", "a design problem"),
        ("problem_disk_control.toml", "a problem of optimal control"),
    ],
)
def test_a_problem_is_one_for_design(command, file, what, capsys):
    sentence = f"jaxball: {file} is {what}; run it with `jaxball design {file} --out FOLDER`.\n"
    assert _refusal(capsys, command, file) == sentence


def test_standard_input_is_named_as_such(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO(STUDY))
    sentence = "jaxball: standard input is a study; run it with `jaxball sweep FILE --out STORE`.\n"
    assert _refusal(capsys, "simulate {}", "-") == sentence


def test_a_study_whose_axes_are_misspelt_is_still_one(folder, capsys):
    (folder / "study.toml").write_text(STUDY.replace("axes", "axis"))
    assert "study.toml is a study; run it with" in _refusal(capsys, "simulate {}", "study.toml")
    assert "Key `axis` is not known; did you mean `axes`?" in _refusal(capsys, OF_STUDIES, "study.toml")
    assert "Key `axis` is not known; did you mean `axes`?" in _refusal(capsys, "validate {}", "study.toml")
