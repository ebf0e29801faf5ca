"""Where output goes: through symbolic links, into pipes that close, and to places that cannot be, before the solve."""

import os
import re
import subprocess
import sys

import pytest

from jaxball.cli import main
from jaxball.interface.output import OutputError, check_destination, check_folder, replacing
from jaxball.sweep import sweep
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
    first = sweep(study(tmp_path, settings="chunk = 4"), tmp_path / "s.zarr", engine=pretend, shard=(1, 2))
    (elsewhere / "s.parquet").symlink_to(tmp_path / "table")
    assert first.store == elsewhere / "s.zarr"
    sweep(study(tmp_path, settings="chunk = 4"), tmp_path / "s.zarr", engine=pretend)
    assert (tmp_path / "s.zarr").is_symlink()
    assert (elsewhere / "s.parquet").is_symlink()
    assert (tmp_path / "table").read_bytes().startswith(b"PAR1")


IMPOSSIBLE = {
    "loop.csv": r'must be a file that can be written, but "\S+loop\.csv" is not: Too many levels of symbolic links\.$',
    "lost.csv": r'must lie in a folder that exists, but "\S+/none", to which "\S+lost\.csv" leads, does not',
    "file/run.csv": r'must lie in a folder, but "\S+/file" is a file\.$',
    "none/run.csv": r'must lie in a folder that exists, but "\S+/none" does not; make it first\.$',
    "folder.csv": r'must be a file, but "\S+/folder\.csv" is a folder\.$',
    "run.txt": r'must end in \.csv, but it is "\S+/run\.txt"\.$',
    "a" * 300 + ".csv": r'must be a file that can be written, but "\S+" is not: File name too long\.$',
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_a_place_where_no_file_can_be(tmp_path, name):
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    (tmp_path / "lost.csv").symlink_to("none/run.csv")
    (tmp_path / "file").write_text("precious")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(OutputError, match="^Argument `--out` " + IMPOSSIBLE[name]):
        check_destination(tmp_path / name, (".csv",), "--out")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("file", r'must be a folder, but "\S+/file" is a file\.$'),
        ("file/a/b", r'must be a folder, but "\S+/file/a/b" would lie in "\S+/file", which is a file\.$'),
        ("link/a", r'must be a folder, but "\S+/link" is a symbolic link that leads to none\.$'),
        ("loop", r'must be a folder, but "\S+/loop" is a symbolic link that leads to none\.$'),
    ],
)
def test_a_place_where_no_folder_can_be(tmp_path, name, sentence):
    (tmp_path / "file").write_text("precious")
    (tmp_path / "link").symlink_to("none")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OutputError, match="^Argument `--plot` " + sentence):
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
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"jaxball: Argument `{arguments[-2]}` must ")
    assert '"file" is a file.' in captured.err or 'would lie in "file", which is a file.' in captured.err


def test_a_sweep_refuses_before_it_begins(tmp_path, capsys):
    (tmp_path / "file").write_text("precious")
    (tmp_path / "study.toml").write_text(study_text(tmp_path))
    assert main(["sweep", "study.toml", "--out", "file/s.zarr"]) == 2
    errors = capsys.readouterr().err
    assert re.match(r"jaxball: Argument `--out` must lie in a folder .* cannot be made: Not a directory\.$", errors)


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
