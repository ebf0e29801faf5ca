"""What a command has computed is written, also where the folder for it has gone meanwhile."""

import json
import os
import shutil
import tempfile

import numpy as np
import pytest

from jaxball import Scenario, load_run
from jaxball.cli import main
from tests.support.sentences import said

pytestmark = pytest.mark.thorough
QUICK = "nonholonomic-particle"


@pytest.fixture
def meanwhile(command_folder, monkeypatch):
    """Calls a function when a run has been simulated."""
    simulate = Scenario.simulate

    def after(action):
        def simulate_and_act(self, **settings):
            run = simulate(self, **settings)
            action()
            return run

        monkeypatch.setattr(Scenario, "simulate", simulate_and_act)

    (command_folder / "out").mkdir()
    return after


def test_the_folder_is_made_again(command_folder, meanwhile, capsys):
    meanwhile(lambda: shutil.rmtree(command_folder / "out", ignore_errors=True))
    outputs = ["--out", "out/run.npz", "--json", "out/run.json", "--view", "out/run.html"]
    assert main(["simulate", QUICK, *outputs]) == 0
    assert capsys.readouterr().err == ""
    assert sorted(path.name for path in (command_folder / "out").iterdir()) == ["run.html", "run.json", "run.npz"]
    assert load_run(command_folder / "out" / "run.npz").ok


def test_the_nearest_folder_takes_what_cannot_go_there(command_folder, meanwhile, capsys):
    def replace_by_file():
        shutil.rmtree(command_folder / "out")
        (command_folder / "out").write_text("a file in its place")

    meanwhile(replace_by_file)
    assert main(["simulate", QUICK, "--out", "out/run.npz"]) == 0
    captured = capsys.readouterr()
    said(captured.err, "out/run.npz")
    assert "written: run.npz" in captured.out
    assert load_run(command_folder / "run.npz").ok


def test_the_current_folder_may_go_too(command_folder, meanwhile, monkeypatch, capsys):
    (command_folder / "current").mkdir()
    (command_folder / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(command_folder / "temporary"))
    monkeypatch.chdir(command_folder / "current")
    meanwhile(lambda: os.rmdir(command_folder / "current"))
    assert main(["simulate", QUICK, "--quiet", "--json", "run.json"]) == 0
    said(capsys.readouterr().err, "run.json")
    content = json.loads((command_folder / "temporary" / "run.json").read_text())
    assert content["ok"]
    assert np.isfinite(content["reached"])
