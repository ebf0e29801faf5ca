"""The line that says how far a study has come."""

import io

import numpy as np
import pytest
import xarray

from jaxball.studies.sweep import open_store
from jaxball.studies.sweep.executors import ChunkResult
from jaxball.studies.sweep.progress import Progress, StatusCounts
from tests.plot.studies import heavy_ones_fail
from tests.sweep.studies import Clock, study

NOTHING = StatusCounts(np.zeros(9, dtype=int), None)


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self):
        return True


class Run:
    """Chunks of 100 rows that workers end at times that a clock shows, and the line after each."""

    def __init__(self, rows=1000, before=NOTHING, mine=1000, parallel=1, stream=None):
        self.stream, self.clock = io.StringIO() if stream is None else stream, Clock()
        self.progress = Progress(self.stream, rows, before, mine, parallel, self.clock)

    def ends(self, at, worker="a", rows=100, failed=0):
        self.clock.now = at
        self.progress.add(ChunkResult(rows, failed, worker))
        return self.progress.line()


def test_compiling_is_no_part_of_the_time_to_go():
    run = Run()
    assert run.progress.line() == "0 of 1,000 rows (0.0 %), 0 failed, compiling"
    unknown = "100 of 1,000 rows (10.0 %), 0 failed, remaining time not known before the next chunk"
    assert run.ends(at=30.0) == unknown
    assert run.ends(at=32.0, failed=3) == "200 of 1,000 rows (20.0 %), 3 failed, 50 rows/s, 16 s to go"
    assert run.ends(at=36.0) == "300 of 1,000 rows (30.0 %), 3 failed, 33.3 rows/s, 21 s to go"


def test_workers_that_compile_side_by_side():
    """Each does 50 rows a second once it has compiled, for 30 or 31 s."""
    run = Run(rows=2000, mine=2000, parallel=2)
    run.ends(at=30.0)
    assert run.ends(at=31.0, worker="b").endswith("not known before the next chunk")
    assert run.ends(at=32.0).endswith("300 of 2,000 rows (15.0 %), 0 failed, 100 rows/s, 17 s to go")
    assert run.ends(at=33.0, worker="b").endswith("100 rows/s, 16 s to go")


def test_workers_that_do_one_chunk_each_compile_for_each():
    run = Run(parallel=2)
    lines = [run.ends(at=30.0 * k, worker=str(k)) for k in (1, 2, 3)]
    assert [line.endswith("not known before the next chunk") for line in lines] == [True, True, False]
    assert lines[-1].endswith("3.33 rows/s, 4 min to go")  # 700 rows at 100 in 30 s


def test_the_end_says_how_long_it_took():
    run = Run(rows=250, mine=250)
    run.ends(at=30.0)
    run.ends(at=31.0)
    assert run.ends(at=42.0, rows=50) == "250 of 250 rows (100.0 %), 0 failed, in 42 s"


def test_lines_of_a_log_and_the_one_line_of_a_terminal():
    log, terminal = Run(rows=400, mine=400), Run(rows=400, mine=400, stream=Terminal())
    for run in (log, terminal):
        for at in (10.0, 31.0, 32.0, 33.0):
            run.ends(at)
        run.progress.close()
    assert [line.split(" of ")[0] for line in log.stream.getvalue().splitlines()] == ["0", "200", "400"]
    shown = terminal.stream.getvalue()
    assert shown.count("\n") == 1
    assert [line.split(" of ")[0] for line in shown.split("\r\x1b[K")[1:]] == ["0", "100", "200", "300", "400", "400"]


def test_nothing_to_do_shows_nothing():
    run = Run(mine=0)
    run.progress.close(NOTHING)
    assert run.stream.getvalue() == ""


@pytest.mark.parametrize("between", [False, True])
def test_failures_after_a_run_goes_on_are_those_in_the_store(tmp_path, between):
    """Where ``between``, another shard writes while this one computes."""
    found, stream = study(tmp_path, settings="chunk = 4"), io.StringIO()
    options = {"engine": heavy_ones_fail}
    found.run(tmp_path / "s.zarr", shard=(4, 4), **options)

    def engine(batch, wanted):
        if between:
            found.run(tmp_path / "s.zarr", shard=(3, 4), **options)
        return heavy_ones_fail(batch, wanted)

    found.run(tmp_path / "s.zarr", shard=(1, 4) if between else (1, 2), engine=engine, stream=stream)
    with xarray.open_zarr(tmp_path / "s.zarr") as data:
        status = data["status"].values[data["row"].values >= 0]
    assert np.count_nonzero(status) == 5
    first, *_, last = stream.getvalue().splitlines()
    assert first == "3 of 15 rows (20.0 %), 2 failed, compiling"
    assert last.startswith("11 of 15 rows (73.3 %), 5 failed, ")
    assert "11 of 15 rows are done (73.3 %)\n  6 SUCCESS\n  5 MAX_STEPS\n" in open_store(tmp_path / "s.zarr").describe()
