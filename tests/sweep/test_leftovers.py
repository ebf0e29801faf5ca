"""What killed processes leave beside a store, and folders that cannot be written."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from jaxball.cli import main
from jaxball.interface.output import part_prefix
from jaxball.studies.sweep import StoreError
from jaxball.studies.sweep.files import SECONDS_OF_A_PART
from tests.sweep.studies import files, pretend, study, study_text

KILLED_WHILE_IT_MAKES_A_STORE = """
import os, signal, sys
from pathlib import Path
import jax
from jaxball.studies.sweep import store
from tests.sweep.studies import pretend, study

jax.config.update("jax_enable_x64", True)
write = store._write_metadata
store._write_metadata = lambda *arguments: (write(*arguments), os.kill(os.getpid(), signal.SIGKILL))
study(Path(sys.argv[1])).run(Path(sys.argv[1]) / "s.zarr", engine=pretend)
"""


@pytest.fixture(scope="module")
def nobody():
    """The number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def part(folder, process=None, machine=None, days=0.0):
    """A folder that a process has not finished, of this process and machine if not given."""
    prefix = part_prefix() if process is None else re.sub(r"-\d+-$", f"-{process}-", part_prefix())
    path = folder / (f"{prefix}1a_b2" if machine is None else f".part-{machine}-0-{process}-1a_b2")
    (path / "store").mkdir(parents=True)
    (path / "store" / "zarr.json").write_text("{}")
    os.utime(path, times=(path.stat().st_mtime - days * SECONDS_OF_A_PART,) * 2)
    return path


@pytest.mark.thorough
def test_a_run_that_was_killed_while_it_made_its_store(tmp_path):
    ended = subprocess.run(
        [sys.executable, "-c", KILLED_WHILE_IT_MAKES_A_STORE, str(tmp_path)],
        cwd=Path(__file__).parents[2],
        timeout=120,
        check=False,
    )
    assert ended.returncode == -9
    (left,) = tmp_path.glob(".part-*")
    assert (left / "store" / "zarr.json").exists()
    assert not (tmp_path / "s.zarr").exists()
    (tmp_path / "whole").mkdir()
    whole = study(tmp_path / "whole").run(tmp_path / "whole" / "s.zarr", engine=pretend)
    outcome = study(tmp_path).run(tmp_path / "s.zarr", engine=pretend)
    assert not left.exists()
    assert files(outcome.store) == files(whole.store)


def test_what_the_dead_left_is_removed_and_nothing_else(tmp_path, nobody):
    dead, old = part(tmp_path, nobody), part(tmp_path, nobody, "elsewhere", days=1.1)
    table = tmp_path / dead.name.replace("1a", "3c")
    table.write_text("")
    living, recent = part(tmp_path), part(tmp_path, nobody, "far-away")
    other = tmp_path / ".part-of-something-else"
    other.mkdir()
    study(tmp_path).run(tmp_path / "s.zarr", engine=pretend)
    assert not any(path.exists() for path in (dead, old, table))
    assert all(path.exists() for path in (living, recent, other))


def test_a_link_is_removed_and_not_what_it_leads_to(tmp_path, nobody):
    precious = tmp_path / "precious"
    precious.mkdir()
    link = part(tmp_path, nobody)
    target = tmp_path / link.name.replace("1a", "3c")
    target.symlink_to(precious, target_is_directory=True)
    study(tmp_path).run(tmp_path / "s.zarr", engine=pretend)
    assert not target.is_symlink()
    assert precious.is_dir()


@pytest.fixture
def read_only(tmp_path):
    """A folder in which nothing can be made."""
    folder = tmp_path / "read-only"
    folder.mkdir()
    folder.chmod(0o555)
    if os.access(folder, os.W_OK):
        pytest.skip("this user, such as root, can write into a read-only folder")
    yield folder
    folder.chmod(0o755)


def test_a_read_only_folder(tmp_path, read_only, command_line, capsys):
    with pytest.raises(StoreError, match=r'must lie in a folder that can be written, but "\S+" cannot be made: Perm'):
        study(tmp_path).run(read_only / "s.zarr", engine=pretend)
    (tmp_path / "study.toml").write_text(study_text(tmp_path))
    assert main(["sweep", str(tmp_path / "study.toml"), "--out", str(read_only / "s.zarr")]) == 2
    assert "must lie in a folder that can be written" in capsys.readouterr().err
    assert list(read_only.iterdir()) == []


def test_figures_in_a_read_only_folder(tmp_path, read_only, command_line, capsys):
    store = study(tmp_path).run(tmp_path / "s.zarr", engine=pretend).store
    assert main(["sweep", "plot", str(store), "--out", str(read_only), "--result", "phi"]) == 2
    assert "Permission denied" in capsys.readouterr().err


def test_a_store_that_became_read_only_is_left_as_it_is(tmp_path, read_only):
    found, place = study(tmp_path, settings="chunk = 4"), tmp_path / "s.zarr"
    found.run(place, engine=pretend, shard=(1, 2))
    folders = [place / ".done", place / "phi" / "c", place / "row" / "c"]
    try:
        for folder in folders:
            folder.chmod(0o555)
        with pytest.raises(StoreError, match=r"cannot be written: Permission denied\. Its contents are intact"):
            found.run(place, engine=pretend)
    finally:
        for folder in folders:
            folder.chmod(0o755)
    assert found.run(place, engine=pretend).finished
