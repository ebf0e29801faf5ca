"""``jaxball validate``: what a file is, and all that is wrong with it."""

import io
from pathlib import Path

import pytest

from jaxball.cli import main
from tests.scenario.documents import DISK
from tests.support.sentences import said

EXAMPLES = Path(__file__).parents[2] / "examples"
STUDY = """
format = 1
scenario = "disk.toml"
[[axes]]
path = "body.mass"
values = [1.0, 2.0]
[[axes]]
path = "body.gravity"
linear = { from = 1.0, to = 2.0, count = 3 }
"""
WRONG = """
format = 1
titel = "wrong in nine places"
kind = "ball"
[body]
mass = -1
inertia = [1, 1]
gravity = 1
[[masses]]
mass = 1
rail = { kind = "circle", radios = 0.5 }
schedule = { kind = "pulse", theta = 0 }
[[masses]]
mas = 2
position = [0, 0, 0]
[time]
start = 0
end = -1
saves = 3
[solve]
rtol = "a"
"""


@pytest.fixture(autouse=True)
def folder(command_folder):
    (command_folder / "disk.toml").write_text(DISK)
    return command_folder


def test_each_kind_of_file_is_known(folder, monkeypatch, capsys):
    (folder / "study.toml").write_text(STUDY)
    monkeypatch.setattr("sys.stdin", io.StringIO(DISK))
    problem, control = (
        str(EXAMPLES / name) for name in ("problem_rail_shape_circles.toml", "problem_disk_control.toml")
    )
    assert main(["validate", "-", "study.toml", problem, control]) == 0
    captured = capsys.readouterr()
    lines = captured.out.splitlines()
    assert captured.err == ""
    assert lines[0].startswith("standard input is valid: a scenario")
    assert "disk with 1 point mass, 5 times from 0 to 2 by" in lines[0]
    assert lines[1].startswith("study.toml is valid: a study: 6 rows (2 × 3) of body.mass, body.gravity")
    assert ": a design problem" in lines[2]
    assert ": a problem of optimal control" in lines[3]


def test_all_problems_are_told_in_the_order_of_the_file(folder, capsys):
    (folder / "wrong.toml").write_text(WRONG)
    assert main(["validate", "disk.toml", "wrong.toml", "none.toml"]) == 2
    captured = capsys.readouterr()
    assert captured.out.startswith("disk.toml is valid")
    *errors, last = captured.err.splitlines()
    named = ["titel", "body.mass", "body.inertia", "body.radius", "time.end", "solve.rtol"]
    of_masses = ["masses[0].rail.radios", "masses[0].rail.radius", "masses[1].mas"]
    assert [line.split("`")[1] for line in errors] == [*named, *of_masses]
    assert all(line.startswith("wrong.toml: Key `") for line in errors)
    said(last, "none.toml")


def test_problems_of_a_study(folder, capsys):
    wrong = (
        STUDY.replace("body.gravity", "body.gravty").replace("[1.0, 2.0]", '"many"').replace("count = 3", "count = 0")
    )
    (folder / "study.toml").write_text(wrong)
    assert main(["validate", "study.toml", "--quiet"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert [line.split("`")[1] for line in captured.err.splitlines()] == ["axes[0].values", "axes[1].linear.count"]


def test_mistakes_in_one_part_of_a_study_do_not_hide_those_in_another(folder, capsys):
    settings = 'titel = "x"\nchunk = 0\ncontact = true\nfind = ["nothing"]\n[[axes]]'
    wrong = STUDY.replace("[[axes]]", settings, 1)
    of_axes = wrong.replace("count = 3", "count = 0").replace("[1.0, 2.0]", "[]")
    of_paths = wrong.replace("body.gravity", "body.gravty").replace("body.mass", "body.mas")
    for study, axes in (
        (of_axes, ["axes[0].values", "axes[1].linear.count"]),
        (of_paths, ["axes[0].path", "axes[1].path"]),
    ):
        (folder / "study.toml").write_text(study)
        assert main(["validate", "study.toml"]) == 2
        told = [line.split("`")[1] for line in capsys.readouterr().err.splitlines()]
        assert told[:-1] == ["titel", "chunk", *axes]
        assert told[-1].startswith("find")


PROBLEM = """
format = 1
scenario = "disk.toml"
titel = "x"
variables = [{ path = "body.mass", lower = 0.5, uper = 2.0 }]
objectives = [{ kind = "go-farr", weigth = 2.0 }]
constraints = [{ kind = "friction", frictions = 3 }]
search = { evaluation = 1 }
robust = { sample = 1 }
"""


def test_mistakes_in_one_part_of_a_problem_do_not_hide_those_in_another(folder, capsys):
    """But for goals and limits, which can be read where the variables can."""
    first = ["titel", "variables[0].uper", "search.evaluation", "robust.sample"]
    goals = ["objectives[0].weigth", "objectives[0].kind", "constraints[0].frictions", "constraints[0].friction"]
    right = PROBLEM.replace("uper", "upper").replace('titel = "x"', "")
    for text, named in ((PROBLEM, first), (right, [*first[2:], *goals])):
        (folder / "problem.toml").write_text(text)
        assert main(["validate", "problem.toml"]) == 2
        told = [line.split("`")[1] for line in capsys.readouterr().err.splitlines()]
        assert [name for name in told if name in {*first, *goals}] == named


def test_what_is_no_toml(folder, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO("a = = 1"))
    assert main(["validate", "-"]) == 2
    said(capsys.readouterr().err, "standard input")


MISTAKES = """
format = 1
kind = "ball"
body = { mass = 1e300, inertia = [0.5, 0.6, 0.7], radius = 1.0, gravity = 1.0 }
force = { constant = [1, 2] }
time = { start = 0.0, end = 1.0, saves = 3 }
solve = { rtool = 1e-3 }
[[masses]]
mass = 0.5
position = [0.0, 0.0, 1.5]
[[masses]]
mass = 0.5
position = [0.0, 2.0, 0.0]
"""


def test_mistakes_of_one_kind_do_not_hide_those_of_another(folder, capsys):
    """Words that are not known, then masses that are outside, then numbers with which no solve starts."""
    (folder / "wrong.toml").write_text(MISTAKES)
    assert main(["validate", "wrong.toml"]) == 2
    told = capsys.readouterr().err.splitlines()
    named = ["force.constant", "solve.rtool", "masses[0].position", "masses[1].position", "body.mass"]
    assert [line.split("`")[1] for line in told] == named
    for number, line in enumerate(["force = { constant = [1, 2] }", "solve = { rtool = 1e-3 }"], start=1):
        (folder / "wrong.toml").write_text(MISTAKES.replace(line, ""))
        assert main(["validate", "wrong.toml"]) == 2
        told = capsys.readouterr().err.splitlines()
        assert [line.split("`")[1] for line in told] == [name for k, name in enumerate(named, start=1) if k != number]


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("mass = 1.0", "mass = 1e300", "body.mass"),
        ("mass = 0.5", "mass = 1e300", "masses[0].mass"),
        ("mass = 1.0", "mass = 1e200", "body.mass"),
        ("radius = 1.0", "radius = 1e200", "body.radius"),
    ],
)
def test_what_no_run_can_start_with_is_not_valid(folder, capsys, old, new, key):
    assert old in DISK
    (folder / "wrong.toml").write_text(DISK.replace(old, new, 1))
    assert main(["validate", "wrong.toml"]) == 2
    said(capsys.readouterr().err, key)


def test_large_numbers_that_do_no_harm_are_valid(folder, capsys):
    (folder / "large.toml").write_text(DISK.replace("mass = 1.0", "mass = 1e30"))
    assert main(["validate", "large.toml"]) == 0
    assert capsys.readouterr().err == ""
