"""What each command says of a file of another kind, and that it names the command that runs it."""

import io
import shlex
from pathlib import Path

import pytest

from tests.scenario.documents import DISK
from tests.support.commands import refuses_command

EXAMPLES = Path(__file__).parents[2] / "examples"
STUDY = 'format = 1\nscenario = "disk.toml"\n[[axes]]\npath = "body.mass"\nvalues = [1.0, 2.0]\n'
OF_RUNS = ("view {} --out run.html", "plot {} --out figures", "import {}")
OF_STUDIES, OF_PROBLEMS = "sweep {} --out new.zarr", "design {} --out new"
OF_SCENARIOS = (
    "simulate {}",
    "track {}",
    "verify disk.toml {}",
    "chaos {}",
    "stability {}",
    "periodic {} --period 1",
    "export {} --to mjcf",
)
RIGHT = {
    "a study.toml": "jaxball sweep 'a study.toml' --out STORE",
    "disk.toml": "jaxball simulate disk.toml",
    "problem_rail_shape_circles.toml": "jaxball design problem_rail_shape_circles.toml --out FOLDER",
    "problem_disk_control.toml": "jaxball design problem_disk_control.toml --out FOLDER",
}
WRONG = {
    "a study.toml": [*OF_SCENARIOS, *OF_RUNS, OF_PROBLEMS],
    "disk.toml": [*OF_RUNS, OF_PROBLEMS, OF_STUDIES],
    "problem_rail_shape_circles.toml": [*OF_SCENARIOS, *OF_RUNS, OF_STUDIES],
    "problem_disk_control.toml": [*OF_SCENARIOS, *OF_RUNS, OF_STUDIES],
}


@pytest.fixture(autouse=True)
def folder(command_folder):
    """A scenario, a study and a problem."""
    (command_folder / "disk.toml").write_text(DISK)
    (command_folder / "a study.toml").write_text(STUDY)
    for name in ("problem_rail_shape_circles.toml", "problem_disk_control.toml"):
        (command_folder / name).write_text((EXAMPLES / name).read_text())
    return command_folder


def refuses_file(capsys, command, file, *names):
    refuses_command(capsys, shlex.split(command.format(shlex.quote(file))), *names)


@pytest.mark.parametrize(("file", "command"), [(file, command) for file in WRONG for command in WRONG[file]])
def test_a_command_for_other_files_names_the_one_for_this(file, command, capsys):
    refuses_file(capsys, command, file, file, RIGHT[file])


def test_standard_input_is_named_as_such(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO(STUDY))
    refuses_file(capsys, "simulate {}", "-", "standard input", "jaxball sweep FILE --out STORE")


def test_a_study_whose_axes_are_misspelt_is_still_one(folder, capsys):
    (folder / "study.toml").write_text(STUDY.replace("axes", "axis"))
    for command, name in (("simulate {}", "study.toml"), (OF_STUDIES, "axis"), ("validate {}", "axis")):
        refuses_file(capsys, command, "study.toml", name)
