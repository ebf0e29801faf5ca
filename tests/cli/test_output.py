"""Where output goes: through symbolic links, into pipes that close, and to places that cannot be, before the solve."""

import os
import subprocess
import sys

import pytest

from jaxball.interface.output import OutputError, check_destination, check_folder, replacing
from tests.support.commands import refuses_command
from tests.support.sentences import refuses
from tests.sweep.studies import pretend, study, study_text

pytestmark = pytest.mark.usefixtures("command_folder")


def write(path):
    with replacing(path) as beside:
        beside.write_text("new")


def test_what_a_symbolic_link_leads_to_is_written(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "run.csv").write_text("old")
    (tmp_path / "run.csv").symlink_to(elsewhere / "run.csv")
    (tmp_path / "link.csv").symlink_to("run.csv")
    check_destination(tmp_path / "link.csv", (".csv",))
    write(tmp_path / "link.csv")
    assert (elsewhere / "run.csv").read_text() == "new"
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "run.csv").is_symlink()
    assert [path.name for path in elsewhere.iterdir()] == ["run.csv"]


def test_a_link_to_nothing_makes_what_it_leads_to(tmp_path):
    (tmp_path / "run.csv").symlink_to("other.csv")
    check_destination(tmp_path / "run.csv", (".csv",))
    write(tmp_path / "run.csv")
    assert (tmp_path / "other.csv").read_text() == "new"
    assert (tmp_path / "run.csv").is_symlink()


def test_a_store_and_its_table_through_links(tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "s.zarr").symlink_to(elsewhere / "s.zarr")
    first = study(tmp_path, settings="chunk = 4").run(tmp_path / "s.zarr", engine=pretend, shard=(1, 2))
    (elsewhere / "s.parquet").symlink_to(tmp_path / "table")
    assert first.store == elsewhere / "s.zarr"
    study(tmp_path, settings="chunk = 4").run(tmp_path / "s.zarr", engine=pretend)
    assert (tmp_path / "s.zarr").is_symlink()
    assert (elsewhere / "s.parquet").is_symlink()
    assert (tmp_path / "table").read_bytes().startswith(b"PAR1")


IMPOSSIBLE = ("loop.csv", "lost.csv", "file/run.csv", "none/run.csv", "folder.csv", "run.txt", "a" * 300 + ".csv")


@pytest.mark.parametrize("name", IMPOSSIBLE, ids=lambda name: name[:12])
def test_a_place_where_no_file_can_be(tmp_path, name):
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    (tmp_path / "lost.csv").symlink_to("none/run.csv")
    (tmp_path / "file").write_text("precious")
    (tmp_path / "folder.csv").mkdir()
    with refuses(OutputError, "--out", name.partition("/")[0]):
        check_destination(tmp_path / name, (".csv",), "--out")


@pytest.mark.parametrize("name", ["file", "file/a/b", "link/a", "loop"])
def test_a_place_where_no_folder_can_be(tmp_path, name):
    (tmp_path / "file").write_text("precious")
    (tmp_path / "link").symlink_to("none")
    (tmp_path / "loop").symlink_to("loop")
    with refuses(OutputError, "--plot", name.partition("/")[0]):
        check_folder(tmp_path / name, "--plot")


def test_a_folder_that_is_to_be_made(tmp_path):
    check_folder(tmp_path / "a" / "b")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["simulate", "ball", "--plot", "file/figures"],
        ["simulate", "ball", "--out", "file/run.nc"],
        ["simulate", "ball", "--animate", "file/film.gif"],
        ["chaos", "ball", "--plot", "file/means.png"],
        ["verify", "ball", "--json", "file/report.json"],
        ["reproduce", "--out", "file/out"],
        ["design", "problem.toml", "--out", "file/out"],
    ],
    ids=lambda arguments: " ".join(arguments[0::2]),
)
def test_commands_refuse_before_they_begin(tmp_path, capsys, monkeypatch, arguments):
    (tmp_path / "file").write_text("precious")
    monkeypatch.setattr("jaxball.simulation.simulate.simulate", None)
    refuses_command(capsys, arguments, arguments[-2], "file")


def test_a_sweep_refuses_before_it_begins(tmp_path, capsys):
    (tmp_path / "file").write_text("precious")
    (tmp_path / "study.toml").write_text(study_text(tmp_path))
    refuses_command(capsys, ["sweep", "study.toml", "--out", "file/s.zarr"], "--out")


def typed(*arguments, **options):
    return subprocess.run([sys.executable, "-m", "jaxball", *arguments], stderr=subprocess.PIPE, timeout=100, **options)


@pytest.mark.parametrize(("arguments", "code"), [(["scenarios"], 141), (["scenarios", "ball"], 141), (["--help"], 0)])
def test_a_reader_that_has_seen_enough(arguments, code):
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = typed(*arguments, stdout=writing, check=False)
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (code, b"")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no disk that is always full")
def test_a_full_disk():
    with open("/dev/full", "w") as full:
        done = typed("scenarios", stdout=full, check=False)
    assert (done.returncode, done.stderr) == (2, b"jaxball: The output cannot be written: No space left on device.\n")
