"""Views from the command line: of a run that is made, of a saved one, and of one that failed."""

import os

import pytest

from jaxball.cli import main
from jaxball.interface.views import MARK
from tests.scenario.documents import DISK
from tests.support.pages import document_in


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """The command line sets XLA_FLAGS; other tests must not see it."""
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "disk.toml").write_text(DISK)
    return tmp_path


def test_a_saved_run_has_the_view_of_the_run_itself(folder, capsys):
    arguments = ["disk.toml", "--set", 'title="<b>a test"', "--end", "1"]
    assert main(["simulate", *arguments, "--out", "run.nc", "--view", "run.html"]) == 0
    assert "written: run.nc, run.html" in capsys.readouterr().out
    assert main(["view", "run.nc", "--out", "again.html", "--friction", "0.4", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    first, again = (document_in((folder / name).read_text()) for name in ("run.html", "again.html"))
    assert first["title"] == "<b>a test"
    assert first["arrays"]["time"]["shape"] == [5]
    assert again == first | {"friction": 0.4}

    assert main(["view", "run.nc", "--out", "again.html"]) == 0
    assert "written: again.html" in capsys.readouterr().out
    assert document_in((folder / "again.html").read_text()) == first


def test_a_run_that_failed_is_shown_and_marked(folder, capsys):
    failing = ["simulate", "disk.toml", "--set", "solve.max_steps=3", "--view", "run.html"]
    assert main(failing) == 3
    assert 'What was computed is in "run.html", marked as failed.' in capsys.readouterr().err
    document = document_in((folder / "run.html").read_text())
    assert document["ok"] is False
    assert "max_steps" in document["message"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ["simulate", "heavy-top", "--view", "top.html"],
            "`--view` must be left out for a heavy top, which has no",
        ),
        (
            ["simulate", "disk.toml", "--view", "notes.html"],
            "`--view` must be a new file or a view to replace, but",
        ),
        (["simulate", "disk.toml", "--view", "run.txt"], '`--view` must end in .html, but it is "run.txt".'),
        (["view", "disk.toml", "--out", "run.html"], 'read back from a .nc or .npz file, but this is "disk.toml".'),
        (
            ["view", "notes.nc", "--out", "run.html"],
            'The file "notes.nc" must be a run that jaxball saved, but',
        ),
        (
            ["view", "notes.nc", "--out", "notes.html"],
            "`--out` must be a new file or a view to replace, but",
        ),
        (["view", "folder.nc", "--out", "run.html"], 'but "folder.nc" is a folder.'),
        (["view", "notes.nc", "--out", "folder.html"], '`--out` must be a file, but "folder.html" is a folder.'),
    ],
)
def test_what_is_refused_leaves_every_file_as_it_was(folder, capsys, arguments, sentence):
    for name in ("notes.html", "notes.nc"):
        (folder / name).write_text(MARK.upper())
    for name in ("folder.nc", "folder.html"):
        (folder / name).mkdir()
    before = sorted(folder.iterdir())
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err
    assert captured.out == ""
    assert sorted(folder.iterdir()) == before
    assert (folder / "notes.html").read_text() == MARK.upper()


def test_a_saved_run_of_a_classical_system_is_refused(folder, capsys):
    assert main(["simulate", "free-rigid-body", "--end", "1", "--out", "top.nc", "--quiet"]) == 0
    assert main(["view", "top.nc", "--out", "top.html"]) == 2
    assert 'The run "top.nc" is of a free rigid body, which has no shell to show' in capsys.readouterr().err
    assert not (folder / "top.html").exists()
