"""Nothing is lost: runs that were killed at random moments end as if nothing had happened."""

import contextlib
import importlib.util
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.sweep.kills import CHUNKS, FEWEST, once
from tests.sweep.studies import files, study, study_text

ROOT = Path(__file__).parents[2]
COMMAND = "import sys; from jaxball.cli import main; sys.exit(main())"
MANY = '[[axes]]\npath = "body.mass"\nlinear = { from = 1.0, to = 2.0, count = 600 }\n'


@pytest.mark.long
def test_a_run_that_is_killed_at_random_moments_leaves_the_same_files(tmp_path):
    folders = [tmp_path / name for name in ("killed", "whole")]
    for folder in folders:
        folder.mkdir()
    command = [sys.executable, "-m", "tests.sweep.kills", str(folders[0]), "1"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=200)
    assert done.returncode == 0, done.stderr
    kills, computed = map(int, done.stdout.split())
    assert kills == FEWEST
    assert CHUNKS <= computed <= CHUNKS + kills  # a kill loses the chunk being computed, and no other
    once(folders[1])
    assert files(folders[0] / "s.zarr") == files(folders[1] / "s.zarr")


@pytest.mark.thorough
def test_the_command_stops_at_ctrl_c(tmp_path):
    (tmp_path / "study.toml").write_text(study_text(tmp_path, MANY, "chunk = 16"))
    with start(tmp_path, "a.zarr") as run:
        wait_for_chunks(run, tmp_path / "a.zarr", 1)
        run.send_signal(signal.SIGINT)
        text = run.communicate(timeout=120)[1]
    assert run.returncode == 130
    assert "\njaxball: Stopping when the chunks being computed are in the store; press Ctrl-C again to stop" in text
    assert "of 600 rows done; run the same command to resume." in text


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="this system does not show its processes")
def test_the_second_ctrl_c_stops_at_once_and_its_workers_too(tmp_path):
    (tmp_path / "study.toml").write_text(study_text(tmp_path, MANY, "chunk = 16"))
    with start(tmp_path, "a.zarr", "--workers", "2") as run:
        while processes(run.pid) < 4:  # the command, its two workers, and Python's tracker of what they share
            assert run.poll() is None
        assert run.stderr.readline().endswith("compiling\n")
        for words in ("Stopping", "Stopped"):
            os.killpg(run.pid, signal.SIGINT)
            assert run.stderr.readline().startswith(f"jaxball: {words}")
        # At the end of the file nothing of the session runs any more.
        assert run.communicate(timeout=120)[1] == ""
    assert run.returncode == 130
    assert not list(tmp_path.rglob(".part-*"))


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="this system does not show its processes")
def test_workers_end_with_their_parent_when_it_is_killed(tmp_path):
    (tmp_path / "study.toml").write_text(study_text(tmp_path, MANY, "chunk = 16"))
    with start(tmp_path, "a.zarr", "--workers", "2") as run:
        while processes(run.pid) < 4:  # the command, its two workers, and Python's tracker of what they share
            assert run.poll() is None
            time.sleep(0.01)
        run.send_signal(signal.SIGKILL)  # to the command alone
        run.communicate(timeout=120)
    assert run.returncode == -signal.SIGKILL
    deadline = time.monotonic() + 60
    try:
        while processes(run.pid):
            assert time.monotonic() < deadline
            time.sleep(0.01)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(run.pid, signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_the_command_killed_at_random_moments(tmp_path, workers):
    # More rows than five runs of a third of a second reach.
    (tmp_path / "study.toml").write_text(study_text(tmp_path, MANY.replace("600", "6000"), "chunk = 16"))
    with start(tmp_path, "whole.zarr") as run:
        run.communicate(timeout=300)
    moments = random.Random(workers)
    for _ in range(5):
        with start(tmp_path, "killed.zarr", "--workers", workers) as run:
            wait_for_chunks(run, tmp_path / "killed.zarr", chunks(tmp_path / "killed.zarr") + 1)
            time.sleep(moments.uniform(0.0, 0.3))
            assert run.poll() is None
            os.killpg(run.pid, signal.SIGKILL)
    with start(tmp_path, "killed.zarr", "--workers", workers) as run:
        run.communicate(timeout=300)
    assert run.returncode == 0
    assert files(tmp_path / "killed.zarr") == files(tmp_path / "whole.zarr")


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="dask.distributed is not installed")
@pytest.mark.filterwarnings("ignore")
def test_a_dask_cluster_on_this_machine(tmp_path):
    import distributed

    found = study(tmp_path, MANY, "chunk = 64")
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        outcome = found.run(tmp_path / "dask.zarr", executor=client.get_executor())
    assert outcome.finished
    # In processes of its own, with the same flags of XLA as those of the cluster.
    assert files(found.run(tmp_path / "spawned.zarr", workers=2).store) == files(outcome.store)


def processes(session):
    """How many processes a session has."""
    sessions = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            sessions.append(int(path.read_text().rpartition(")")[2].split()[3]))
    return sessions.count(session)


def start(folder, store, *options):
    command = [sys.executable, "-c", COMMAND, "sweep", "study.toml", "--out", store, *options]
    return subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True)


def wait_for_chunks(run, store, wanted):
    deadline = time.monotonic() + 120
    while chunks(store) < wanted:
        assert run.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)


def chunks(store):
    return len(list((store / ".done").glob("[0-9]*")))
