"""Several sweeps into one store at once, and a store that goes away under one."""

import io
import os
import shutil
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import filelock
import pytest

from jaxball.interface.output import part_prefix
from jaxball.studies.sweep import StoreError
from jaxball.studies.sweep.files import is_running
from jaxball.studies.sweep.run import WAITING
from jaxball.studies.sweep.store import remedy_of
from tests.support.sentences import refuses
from tests.sweep.studies import files, pretend, study, study_text

SETTINGS = "chunk = 1"  # so that both have much to write


# The threads of a process share its filter of warnings, which one of them changes for a while.
@pytest.mark.filterwarnings("ignore:Consolidated metadata")
def test_two_sweeps_into_one_new_store(tmp_path):
    """One of them waits, and both end with the files that one alone writes."""
    both, posed = threading.Barrier(2), study(tmp_path, settings=SETTINGS)

    def run(_):
        both.wait()
        return posed.run(tmp_path / "s.zarr", engine=pretend)

    (tmp_path / "alone").mkdir()
    alone = study(tmp_path / "alone", settings=SETTINGS).run(tmp_path / "alone" / "s.zarr", engine=pretend)
    with ThreadPoolExecutor(2) as pool:
        outcomes = list(pool.map(run, range(2)))
    assert [outcome.finished for outcome in outcomes] == [True, True]
    assert files(tmp_path / "s.zarr") == files(alone.store)
    assert not list(tmp_path.glob(".*"))  # neither locks nor parts


def test_a_sweep_says_that_it_waits_for_another(tmp_path):
    stream, begun = io.StringIO(), threading.Event()

    def engine(batch, request):
        begun.set()
        return pretend(batch, request)

    with ThreadPoolExecutor(1) as pool:
        with filelock.FileLock(tmp_path / ".lock-s.zarr-1-1"):
            waiting = pool.submit(study(tmp_path).run, tmp_path / "s.zarr", engine=engine, stream=stream)
            while not stream.getvalue():
                waiting.exception(0.01) if waiting.done() else threading.Event().wait(0.01)
            assert not begun.is_set()
        assert waiting.result().finished
    assert stream.getvalue().startswith(WAITING)


UNGUARDED = """
import jax
jax.config.update("jax_enable_x64", True)
from jaxball.studies.sweep import load_study
load_study("study.toml").run("s.zarr", workers=2)
"""


@pytest.mark.thorough
def test_a_script_without_a_guard_is_told(tmp_path):
    """Its workers import it, and waited for the store that it had locked, while it waited for them."""
    (tmp_path / "study.toml").write_text(study_text(tmp_path, settings=SETTINGS))
    (tmp_path / "script.py").write_text(UNGUARDED)
    command = [sys.executable, "script.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=100)
    assert done.returncode != 0
    assert '__name__ == "__main__"' in done.stderr


@pytest.mark.parametrize(
    ("arguments", "named"), [({"workers": 0}, "workers"), ({"workers": 1.5}, "workers"), ({"shard": "1/2"}, "shard")]
)
def test_workers_and_shards_that_are_none(no_type_checks, tmp_path, arguments, named):
    with refuses((TypeError, ValueError), named):
        study(tmp_path).run(tmp_path / "s.zarr", engine=pretend, **arguments)


def test_shards_do_not_wait_for_each_other(tmp_path):
    with filelock.FileLock(tmp_path / ".lock-s.zarr-1-2"):
        half = study(tmp_path, settings=SETTINGS).run(tmp_path / "s.zarr", shard=(2, 2), engine=pretend)
    assert half.done == 7  # of 15 rows


def test_what_another_is_writing_stays(tmp_path):
    """Where there are no locks, two sweeps may write the same chunk, and one is done before the other."""
    (tmp_path / "s.zarr").parent.mkdir(exist_ok=True)
    writing = []

    def engine(batch, request):
        if not writing:
            writing.append(tmp_path / "s.zarr" / "z" / f"{part_prefix()}ab12")
            writing[0].write_text("half of a chunk")
        return pretend(batch, request)

    assert study(tmp_path).run(tmp_path / "s.zarr", engine=engine).finished
    assert writing[0].read_text() == "half of a chunk"


def test_a_store_that_is_removed_under_a_sweep(tmp_path):
    def engine(batch, request):
        shutil.rmtree(tmp_path / "s.zarr")
        return pretend(batch, request)

    with refuses(StoreError, "s.zarr"):
        study(tmp_path).run(tmp_path / "s.zarr", engine=engine)
    assert not (tmp_path / "s.zarr").exists()
    assert study(tmp_path).run(tmp_path / "s.zarr", engine=pretend).finished


def test_space_is_asked_for_where_there_is_none():
    assert remedy_of(OSError(28, os.strerror(28))) == "free some space, and "
    assert remedy_of(PermissionError(13, os.strerror(13))) == ""


def test_who_is_running():
    assert is_running(os.getpid())
    assert not is_running(2**30)  # beyond every process number
