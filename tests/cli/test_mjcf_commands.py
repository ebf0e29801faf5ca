"""``jaxball export`` and ``jaxball import``: their files and their refusals."""

import csv
import tomllib

import mujoco
import numpy as np
import pytest

from jaxball import load_scenario
from jaxball.cli import main
from jaxball.files.scenario.sources import SCHEMAS
from tests.support.commands import refuses_command
from tests.support.sentences import said
from tests.urdf.robots import URDF

ROBOT = """
format = 1
title = "a pendulum in a ball"
kind = "ball"
body = { mass = 1.0, radius = 0.5, inertia = [0.1, 0.1, 0.1], gravity = 9.8 }
time = { start = 0.0, end = 1.0, step = 0.5 }

[[mechanisms]]
joints = [{ kind = "hinge", axis = [0.0, 1.0, 0.0], force = { kind = "motor", signal = 0.25 } }]
masses = [{ mass = 0.5, place = [0.0, 0.0, -0.25] }]
"""


@pytest.fixture
def robot(command_folder):
    (command_folder / "robot.toml").write_text(ROBOT)
    return command_folder


@pytest.fixture
def files(robot):
    """The folder with a robot in URDF, and an MJCF file."""
    (robot / "robot.urdf").write_text(URDF.replace("<robot", "<!-- not for <mujoco> -->\n<robot", 1))
    (robot / "robot.xml").write_text("<mujoco/>")
    return robot


@pytest.mark.thorough
def test_a_robot_in_urdf_becomes_a_scenario(files, capsys):
    assert main(["import", "robot.urdf", "--shell", "shell", "--out", "again.toml", "--end", "1", "--step", "0.5"]) == 0
    told = capsys.readouterr().out
    said(told, '<joint name="swing">')
    assert told.endswith("written: again.toml\n")
    again = tomllib.loads((files / "again.toml").read_text())
    assert (again["title"], again["body"]["radius"], again["time"]["end"]) == ("pendulum robot", 0.3, 1.0)
    assert [joint["kind"] for joint in again["mechanisms"][0]["joints"]] == ["hinge", "hinge", "slider"]


def test_a_robot_whose_masses_are_outside_is_written_with_a_note(files, capsys):
    """It can be mended in the scenario, which `jaxball simulate` refuses until then."""
    outside = (files / "robot.urdf").read_text().replace('xyz="0 0 -0.15"/><mass', 'xyz="0 0 -0.45"/><mass')
    (files / "robot.urdf").write_text(outside)
    assert main(["import", "robot.urdf", "--shell", "shell", "--out", "again.toml"]) == 0
    told = capsys.readouterr().out
    said(told, "mechanisms[0]")
    assert main(["simulate", "again.toml"]) == 2
    said(capsys.readouterr().err, "mechanisms[0]")


@pytest.mark.thorough
def test_a_robot_goes_to_mujoco_and_back(robot, capsys):
    assert main(["export", "robot.toml", "--to", "mjcf", "--out", "robot.xml", "--controls", "controls.csv"]) == 0
    told = capsys.readouterr().out
    said(told, "robot.xml", "controls.csv")
    model = mujoco.MjModel.from_xml_path("robot.xml")
    assert np.isclose(model.body_mass.sum(), 1.5)
    header, *rows = csv.reader((robot / "controls.csv").read_text().splitlines())
    assert header == ["t", "mechanisms[0].joints[0]"]
    assert rows == [["0.0", "0.25"], ["0.5", "0.25"], ["1.0", "0.25"]]
    assert main(["import", "robot.xml", "--out", "again.toml", "--end", "1", "--step", "0.5", "--quiet"]) == 0
    written = (robot / "again.toml").read_text()
    given, again = tomllib.loads(ROBOT), tomllib.loads(written)
    assert capsys.readouterr().out == ""
    assert written.startswith(f"#:schema {(SCHEMAS / 'scenario.json').as_uri()}\n")
    assert again["body"] == given["body"]
    assert again["mechanisms"] == [
        {"joints": given["mechanisms"][0]["joints"], "masses": given["mechanisms"][0]["masses"]}
    ]
    assert again["time"]["end"] == 1.0
    # Without an end and a step, those of the scenario, which the file keeps.
    assert main(["import", "robot.xml", "--out", "same.toml", "--quiet"]) == 0
    assert load_scenario("same.toml").times.tolist() == [0.0, 0.5, 1.0]
    assert main(["import", "robot.xml", "--out", "more.toml", "--end", "2", "--step", "1", "--quiet"]) == 0
    assert load_scenario("more.toml").times.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    ("command", "file", "own"),
    [
        (["import", "robot.xml"], "mine.toml", False),
        (["export", "robot.toml", "--to", "mjcf"], "mine.xml", True),
    ],
    ids=["import", "export"],
)
def test_a_file_written_by_hand_is_replaced_only_by_force(robot, capsys, command, file, own):
    """The same content may be written again, and an export over another; an import may have been edited since."""
    assert main(["export", "robot.toml", "--to", "mjcf", "--out", "robot.xml", "--quiet"]) == 0
    (robot / file).write_text("# my own\n")
    refuses_command(capsys, [*command, "--out", file], "--out", "--force")
    assert (robot / file).read_text() == "# my own\n"
    assert main([*command, "--out", file, "--force", "--quiet"]) == 0
    written = (robot / file).read_text()
    assert main([*command, "--out", file, "--quiet"]) == 0
    (robot / file).write_text(written.replace("0.5", "0.25"))
    if own:
        assert main([*command, "--out", file, "--quiet"]) == 0
        assert (robot / file).read_text() == written
    else:
        refuses_command(capsys, [*command, "--out", file], "--out", "--force")


def test_files_go_to_standard_output(robot, capsys):
    assert main(["export", "robot.toml", "--to", "mjcf", "--timestep", "0.001"]) == 0
    captured = capsys.readouterr()
    assert mujoco.MjModel.from_xml_string(captured.out).opt.timestep == 0.001
    said(captured.err, "MuJoCo")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["export", "suslov", "--to", "mjcf"], "kind"),
        (["export", "robot.toml", "--to", "mjcf", "--out", "a.txt"], "--out"),
        (["import", "robot.toml"], "jaxball simulate robot.toml"),
        (["import", "none.xml"], "none.xml"),
        (["import", "robot.urdf", "--end", "12", "--step", "5"], "--step"),
        (["import", "robot.urdf", "--contact"], "--contact"),
        (["import", "robot.xml", "--shell", "a"], "--shell"),
        (["import", "robot.urdf", "--shell", "shel"], "--shell"),
    ],
)
@pytest.mark.usefixtures("files")
def test_what_is_impossible_is_refused_with_a_sentence(capsys, arguments, named):
    refuses_command(capsys, arguments, named)


@pytest.mark.parametrize("out", [[], ["--out", "robot.xml"]], ids=["printed", "written"])
def test_controls_of_a_robot_without_any_are_refused_before_it_is_written(robot, capsys, out):
    (robot / "robot.toml").write_text(ROBOT.partition("[[mechanisms]]")[0])
    refuses_command(capsys, ["export", "robot.toml", "--to", "mjcf", *out, "--controls", "controls.csv"], "--controls")


def test_what_is_no_xml_is_refused(robot, capsys):
    (robot / "robot.txt").write_text("a robot")
    refuses_command(capsys, ["import", "robot.txt"], "The file")
