"""``jaxball simulate`` and ``validate`` of a scenario with events: what is printed, and what is in JSON."""

import json

import numpy as np
import pytest

from jaxball.cli import main
from tests.support.commands import refuses_command
from tests.support.sentences import said

ROLLING = """
format = 1
title = "A disk at z = 1.5 t"
kind = "disk"
body = { mass = 1.0, radius = 1.0, inertia = 0.5, gravity = 1.0 }
initial = { phidot = -1.5 }
time = { start = 0.0, end = 2.0, saves = 5 }

[events.far]
of = "z"
level = 2.4
terminal = true

[events.near]
of = "z"
level = 0.75

[events.never]
of = "z"
level = -1.0
"""
SLIDING_PARTICLE = """
format = 1
kind = "nonholonomic-particle"
initial = { xdot = 0.5 }
time = { start = 0.0, end = 4.0, saves = 5 }
events.post = { of = "x", level = 1.25, terminal = true }
"""


@pytest.fixture(autouse=True)
def folder(command_folder):
    """A folder with a scenario."""
    (command_folder / "rolling.toml").write_text(ROLLING)
    (command_folder / "particle.toml").write_text(SLIDING_PARTICLE)
    return command_folder


@pytest.mark.long
def test_each_event_has_a_line_and_an_entry_in_json(folder, capsys):
    """Along with everything that is drawn of a run that an event ended."""
    drawn = ["--plot", "figures", "--view", "view.html", "--out", "run.nc", "--animate", "rolling.gif", "--fps", "2"]
    assert main(["simulate", "rolling.toml", "--json", "run.json", *drawn]) == 0
    printed = capsys.readouterr().out
    assert "The run ended at t = 1.6 before t = 2, where an event ended it." in printed
    assert "  far: It happened once, at t = 1.6.\n" in printed
    assert "  near: It happened once, at t = 0.5.\n" in printed
    assert "  never: It never happened: its function was between 1 and " in printed
    content = json.loads((folder / "run.json").read_text())
    assert (content["status"], content["ok"]) == ("EVENT", True)
    assert {name: event["count"] for name, event in content["events"].items()} == {"far": 1, "near": 1, "never": 0}
    np.testing.assert_allclose(content["events"]["far"]["times"], [1.6], rtol=1e-12)
    assert content["events"]["never"]["times"] == []
    assert all((folder / name).exists() for name in ("figures", "view.html", "run.nc", "rolling.gif"))


@pytest.mark.thorough
def test_a_level_is_changed_and_an_event_besides_is_found(capsys):
    command = ["simulate", "rolling.toml", "--set", "events.far.level=9", "--set", "events.never=", "--friction", "0.2"]
    assert main([*command, "--json", "-"]) == 0
    captured = capsys.readouterr()
    content = json.loads(captured.out)
    assert content["status"] == "SUCCESS"
    assert {name: event["count"] for name, event in content["events"].items()} == {"far": 0, "near": 1, "slip": 0}
    said(captured.err)


@pytest.mark.thorough
def test_conserved_quantities_of_a_run_that_an_event_ended_are_numbers(capsys):
    assert main(["simulate", "particle.toml", "--json", "-"]) == 0
    content = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(content["reached"], 2.5, rtol=1e-9)
    assert 0 <= content["law_changes"]["energy"] < 1e-9


def test_validate_names_the_key_of_an_event_of_nothing(folder, capsys):
    (folder / "wrong.toml").write_text(ROLLING.replace('of = "z"', 'of = "normal"', 1))
    assert main(["validate", "rolling.toml", "wrong.toml"]) == 2
    captured = capsys.readouterr()
    assert 'rolling.toml is valid: a scenario, "A disk at z = 1.5 t"' in captured.out
    said(captured.err, "events.far.of")
    assert captured.err.count("wrong.toml") == 1


@pytest.mark.parametrize("command", [["stability"], ["chaos"], ["verify"]])
def test_commands_that_need_whole_runs_refuse_one_that_ends(command, capsys):
    refuses_command(capsys, [*command, "rolling.toml"], "events.far.terminal")
