"""``jaxball verify``."""

import json
import os

import pytest

from jaxball.cli import main
from jaxball.scenario import builtin_text


@pytest.fixture(autouse=True)
def environment(monkeypatch, tmp_path):
    """The command line sets XLA_FLAGS; other tests must not see it."""
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    monkeypatch.chdir(tmp_path)
    text = builtin_text("nonholonomic-particle")
    fast = text.replace("\ny = 1.0", "\ny = -20.0").replace("ydot = 1.0", "ydot = 40.0")
    (tmp_path / "loose.toml").write_text(fast + "\n[solve]\nrtol = 0.03\natol = 0.03\n")
    (tmp_path / "fails.toml").write_text(text + "\n[solve]\nmax_steps = 1\n")


def test_some_laws_of_a_scenario(tmp_path, capsys):
    assert main(["verify", "nonholonomic-particle", "--laws", "p_y", "error", "--json", "report.json"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("nonholonomic-particle: A particle with dz/dt = y dx/dt")
    assert "e-fold in" in text
    content = json.loads((tmp_path / "report.json").read_text())["nonholonomic-particle"]
    assert content["ok"] is True
    assert {row["law"]: row["verdict"] for row in content["rows"]} == {"p_y": "holds", "error": "holds"}


def test_a_run_that_is_not_to_be_believed(capsys):
    assert main(["verify", "loose.toml", "nonholonomic-particle", "--laws", "error"]) == 1
    text = capsys.readouterr().out
    assert text.count("Do not believe this run: the error is") == 1


def test_a_solve_that_fails(capsys):
    assert main(["verify", "fails.toml", "--laws", "energy"]) == 3
    assert "Do not believe this run: The solve stopped at t = " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["nonholonomic-particle", "none.toml"], '"none.toml" (No such file or directory)'),
        (["ball", "--laws", "enrgy"], '`--laws` must hold names of laws, but it holds "enrgy"; did you mean "energy"?'),
        (["ball", "--laws", "qqq"], 'it holds "qqq"; the laws here are energy, momentum, chaplygin, jellett-rate, '),
        (["ball", "--json", "report.txt"], "must end in .json"),
    ],
)
def test_bad_arguments(capsys, arguments, sentence):
    assert main(["verify", *arguments]) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err
    assert captured.out == ""
