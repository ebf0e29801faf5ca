"""``jaxball sweep``."""

import importlib.util
import os
import subprocess
import sys
import time

import pytest

from jaxball.cli import main
from jaxball.studies.sweep import run
from tests.support.commands import refuses_command
from tests.support.sentences import said
from tests.sweep.studies import Clock, files, pretend, study, study_text


@pytest.fixture(autouse=True)
def folder(command_folder):
    (command_folder / "study.toml").write_text(study_text(command_folder, settings='title = "Disks"'))
    (command_folder / "wrong.toml").write_text(study_text(command_folder).replace("body.mass", "body.mas"))
    (command_folder / "file").write_text("")
    (command_folder / "mine.zarr").mkdir()
    return command_folder


def test_status(folder, capsys):
    study(folder, settings='title = "Disks"\nchunk = 4').run(folder / "s.zarr", engine=pretend, shard=(1, 2))
    assert main(["sweep", "status", "s.zarr"]) == 0
    assert capsys.readouterr().out == "Disks\n8 of 15 rows are done (53.3 %)\n  8 SUCCESS\n"


def test_a_finished_study_is_not_computed_again(folder, capsys):
    outcome = study(folder, settings='title = "Disks"').run(folder / "s.zarr", engine=pretend)
    before = files(outcome.store)
    assert main(["sweep", "study.toml", "--out", "s.zarr"]) == 0
    captured = capsys.readouterr()
    assert "15 of 15 rows are done (100.0 %)" in captured.out
    assert "s.zarr, " in captured.out.splitlines()[-1]
    assert captured.err == ""
    assert files(outcome.store) == before


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["wrong.toml", "--out", "s.zarr"], "body.mass"),
        (["study.toml", "--out", "s.nc"], "--out"),
        (["study.toml", "--out", "file/s.zarr"], "file"),
        (["study.toml", "--out", "mine.zarr"], "mine.zarr"),
        (["status", "mine.zarr"], "mine.zarr"),
        (["status", "none.zarr"], "none.zarr"),
        (["plot", "none.zarr", "--out", "f"], "none.zarr"),
    ],
)
def test_bad_input(folder, capsys, arguments, named):
    before = sorted(folder.rglob("*"))
    refuses_command(capsys, ["sweep", *arguments], named)
    assert sorted(folder.rglob("*")) == before  # of stores as well


def test_a_dry_run_solves_nothing(folder, capsys):
    axes = '[[axes]]\npath = "body.mass"\nlinear = { from = 1, to = 2, count = 1_000_000 }\n'
    found = study(folder, axes).estimate(never)
    size = 123 * 8192 * (8 + 8 + 1 + 4 + 4 + 8 + 3 * 8) + 8 * 1_000_000  # bytes a row, in whole chunks, and the axis
    size += 4 * (9 * 123 + 1)  # a checksum for each file
    assert found[:5] == (1_000_000, 123, size, None, None)
    assert found.sentence() == "1,000,000 rows in 123 chunks, a store of 65.4 MB"
    assert main(["sweep", "study.toml", "--dry-run"]) == 0
    assert capsys.readouterr().out == (
        "15 rows in 1 chunk, a store of 1.09 kB; --measure solves a few rows to estimate the time\n"
    )


def test_a_dry_run_needs_none_of_the_packages_that_a_sweep_needs(folder, capsys, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pyarrow" else find(name))
    assert main(["sweep", "study.toml", "--dry-run"]) == 0
    assert capsys.readouterr().out.startswith("15 rows in 1 chunk, ")
    assert main(["sweep", "study.toml", "--out", "s.zarr"]) == 2
    said(capsys.readouterr().err, "A sweep")


def test_the_size_of_an_estimate_is_that_of_the_numbers_in_the_store(folder):
    found = study(folder, settings="chunk = 4")
    store = found.run(folder / "s.zarr", engine=pretend).store
    assert found.estimate().size == sum(path.stat().st_size for path in store.rglob("c/*"))


def test_an_estimate_that_is_measured_keeps_compiling_apart(folder, monkeypatch):
    clock = Clock()

    def compiling_at_first(batch, wanted):
        clock.now += 1.5 if clock.now else 31.5
        return pretend(batch, wanted)

    monkeypatch.setattr("time.perf_counter", clock)
    found = study(folder, settings="chunk = 4").estimate(compiling_at_first, measure=True, workers=1)
    assert (found.compiling, found.solving) == (30.0, 1.5 * 15 / 4)
    assert found.sentence().endswith(", about 5.6 s with 1 worker after compiling for 30 s")


@pytest.mark.thorough
def test_an_estimate_for_processes_has_their_start(folder):
    """A process imports JAX before it solves, which takes longer than these rows; so one worker is the quickest."""
    one = study(folder, settings="chunk = 4")
    two = one.estimate(pretend, measure=True, workers=2)
    start = time.perf_counter()
    assert one.run(folder / "two.zarr", workers=2, engine=pretend).finished
    took = time.perf_counter() - start
    assert two.workers == 2
    assert two.starting > 0.25 * took
    assert ", about " in two.sentence()
    assert " of it to start after compiling" in two.sentence()
    assert one.estimate(pretend, measure=True).workers == 1


def test_the_quickest_number_of_workers_is_estimated(folder, monkeypatch):
    """Where processes take half the time of one, and half a second to start."""
    monkeypatch.setattr(run, "_alone", lambda *_: {"compiling": 1.0, "solving": 40.0})
    monkeypatch.setattr(run, "_together", lambda *_: {"starting": 0.5, "solving": 20.0})
    monkeypatch.setattr(run, "cores", lambda: 2)
    one = study(folder, settings="chunk = 1")
    assert one.estimate(pretend, measure=True)[3:] == (1.0, 20.0, 0.5, 2)
    monkeypatch.setattr(run, "_together", lambda *_: {"starting": 25.0, "solving": 20.0})
    assert one.estimate(pretend, measure=True)[3:] == (1.0, 40.0, 0.0, 1)
    assert one.estimate(pretend, measure=True, workers=2)[3:] == (1.0, 20.0, 25.0, 2)


def never(batch, wanted):
    """An engine that must not be called."""
    raise AssertionError


@pytest.mark.thorough
def test_a_gpu_that_is_not_there_is_a_sentence(folder):
    command = [sys.executable, "-m", "jaxball", "sweep", "study.toml", "--out", "s.zarr", "--device", "gpu"]
    hidden = {**os.environ, "CUDA_VISIBLE_DEVICES": "-1"}
    done = subprocess.run(command, env=hidden, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "jaxball: Option `--device` must name a device that JAX can use here, but it is gpu" in done.stderr
    assert not (folder / "s.zarr").exists()
