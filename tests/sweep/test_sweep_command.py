"""``jaxball sweep``."""

import io
import os

import pytest

from jaxball.cli import main
from jaxball.sweep import estimate, sweep
from jaxball.sweep.progress import Progress, duration
from tests.sweep.studies import files, pretend, study, study_text


@pytest.fixture(autouse=True)
def folder(monkeypatch, tmp_path):
    """The command line sets XLA_FLAGS; other tests must not see it."""
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(study_text(tmp_path, settings='title = "Disks"'))
    (tmp_path / "wrong.toml").write_text(study_text(tmp_path).replace("body.mass", "body.mas"))
    (tmp_path / "file").write_text("")
    (tmp_path / "mine.zarr").mkdir()
    return tmp_path


def test_status(folder, capsys):
    sweep(study(folder, settings='title = "Disks"\nchunk = 4'), folder / "s.zarr", engine=pretend, shard=(1, 2))
    assert main(["sweep", "status", "s.zarr"]) == 0
    assert capsys.readouterr().out == "Disks\n8 of 15 rows are done (53.3 %)\n  8 SUCCESS\n"


def test_a_finished_study_is_not_computed_again(folder, capsys):
    outcome = sweep(study(folder, settings='title = "Disks"'), folder / "s.zarr", engine=pretend)
    before = files(outcome.store)
    assert main(["sweep", "study.toml", "--out", "s.zarr"]) == 0
    captured = capsys.readouterr()
    assert "15 of 15 rows are done (100.0 %)" in captured.out
    assert "s.zarr, " in captured.out.splitlines()[-1]
    assert captured.err == ""
    assert files(outcome.store) == before


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["none.toml", "--out", "s.zarr"], '"none.toml" (No such file or directory)'),
        (["wrong.toml", "--out", "s.zarr"], "did you mean `body.mass`?"),
        (["study.toml", "--out", "s.nc"], "must end in .zarr"),
        (["study.toml", "--out", "file/s.zarr"], "must lie in a folder that can be written"),
        (["study.toml", "--out", "mine.zarr"], "must be the store of a study, but it is something else"),
        (["status", "mine.zarr"], "must be the store of a study"),
        (["status", "none.zarr"], "must be the store of a study"),
    ],
)
def test_bad_input(folder, capsys, arguments, sentence):
    before = sorted(folder.rglob("*"))
    assert main(["sweep", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("jaxball: ")
    assert sentence in captured.err
    assert captured.out == ""
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    "arguments",
    [
        ["study.toml"],
        ["status"],
        ["study.toml", "s.zarr"],
        ["study.toml", "--out", "s.zarr", "--workers", "0"],
        ["study.toml", "--out", "s.zarr", "--shard", "3/2"],
        ["study.toml", "--out", "s.zarr", "--shard", "2"],
    ],
)
def test_usage(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        main(["sweep", *arguments])
    assert caught.value.code == 2
    assert "usage: jaxball sweep" in capsys.readouterr().err


def test_the_estimate_of_a_million_rows(folder):
    axes = '[[axes]]\npath = "body.mass"\nlinear = { from = 1, to = 2, count = 1_000_000 }\n'
    found = estimate(study(folder, axes), pretend)
    size = 123 * 8192 * (8 + 8 + 1 + 4 + 4 + 8 + 3 * 8)  # bytes a row, in whole chunks
    assert found[:3] == (1_000_000, 123, size)
    assert found.sentence(2).startswith("1,000,000 rows in 123 chunks, a store of 57.4 MB, about ")


def test_progress_is_rows_rate_time_to_go_and_failures():
    stream = io.StringIO()
    progress = Progress(stream, 1000, 400, 200)
    progress.add(100, 3)
    progress.close()
    assert stream.getvalue().startswith("500 of 1,000 rows (50.0 %), ")
    assert stream.getvalue().endswith(" to go, 3 failed\n")
    assert [duration(x) for x in (0.12, 42.0, 300.0, 11520.0)] == ["0.12 s", "42 s", "5 min", "3.2 h"]
