"""The progress of a study: the outcomes of the rows in its store, and the line that a running sweep shows."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Int

from ...interface.activity import ERASE
from ...interface.status import SUCCESSES, Status
from ...interface.wording import duration
from ...simulation.variables import LEFT_PLANE
from .executors import ChunkResult
from .files import STATUS, check_intact, list_chunks, read_chunk
from .outputs import LEFT, went_on
from .store import read_attributes


class StatusCounts(NamedTuple):
    """How many rows of a store have each status, and the first one that failed, if one did.

    - ``left``: how many rows went on although the body would have left the plane; 0 where a study does not look.
    """

    counts: Int[np.ndarray, " statuses"]
    first: int | None
    left: int = 0

    @property
    def rows(self) -> int:
        """How many rows are done."""
        return int(self.counts.sum())

    @property
    def failed(self) -> int:
        """How many of them have a status other than SUCCESS and EVENT."""
        return self.rows - sum(int(self.counts[status]) for status in SUCCESSES)


def status_counts(folder: Path) -> StatusCounts:
    """Counts the outcomes of the rows that are done.

    **Raises:** :class:`StoreError` when ``folder`` is not the store of a study, and when a file of it has been changed
    from outside; of the numbers, only the statuses and ``left_plane`` are read.
    """
    attributes = read_attributes(folder)
    # Only the sizes of files: the statuses are checked as they are read, and the other numbers are not needed.
    check_intact(folder, numbers=False)
    rows, size = attributes["rows"], attributes["chunk"]
    counts, first, left = np.zeros(len(Status), dtype=int), None, 0
    # Studies without contact forces have no such variable.
    looks = (folder / LEFT).is_dir()
    for chunk in list_chunks(folder):
        status = read_chunk(folder / "status" / "c" / str(chunk), (size,), STATUS)[: rows - chunk * size]
        counts += np.bincount(status, minlength=len(Status))
        failed = ~np.isin(status, SUCCESSES)
        if first is None and np.any(failed):
            first = chunk * size + int(np.argmax(failed))
        if looks:
            path, dtype = folder / LEFT / "c" / str(chunk), np.dtype(LEFT_PLANE[LEFT].dtype)
            flags = read_chunk(path, (size,), dtype)[: status.size]
            left += went_on(status, flags)
    return StatusCounts(counts, first, left)


SECONDS_BETWEEN_LINES = 30.0
SECONDS_BETWEEN_CHANGES = 0.2


@runtime_checkable
class Stream(Protocol):
    """A stream that a line can be shown on, such as ``sys.stderr``."""

    def write(self, text: str, /) -> Any: ...

    def flush(self) -> None: ...

    def isatty(self) -> bool: ...


class Progress:
    """The rows done, failures, and remaining time; on one line of a terminal, otherwise line by line.

    The first chunk of a worker includes compiling, so its speed is measured from the chunks after the first.
    """

    def __init__(
        self,
        stream: Stream,
        rows: int,
        before: StatusCounts,
        mine: int,
        parallel: int = 1,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Starts from the ``rows`` in all, the rows in the store ``before``, and ``mine`` to be done now by
        ``parallel`` workers.
        """
        self.stream, self.rows, self.mine, self.parallel, self.clock = stream, rows, mine, parallel, clock
        self.done, self.failed, self.left, self.now = before.rows, before.failed, before.left, 0
        # By worker, because the first chunk of each has no beginning that is known here.
        self.workers: dict[str, _Worker] = {}
        self.start = self.shown = self.last = clock()
        self.terminal, self.last_line = stream.isatty(), ""
        if mine:
            self.show()

    def add(self, chunk: ChunkResult) -> None:
        """Counts the rows of a chunk that was done, and shows it from time to time."""
        self.now += chunk.rows
        self.done += chunk.rows
        self.failed += chunk.failed
        self.left += chunk.left
        self.last = self.clock()
        seen = self.workers.get(chunk.worker)
        now = _Worker(self.last, self.last, 0) if seen is None else seen.after(chunk.rows, self.last)
        self.workers[chunk.worker] = now
        passed = self.last - self.shown
        if passed > (SECONDS_BETWEEN_CHANGES if self.terminal else SECONDS_BETWEEN_LINES):
            self.show()

    def show(self) -> None:
        """Shows the line now."""
        self.shown, self.last_line = self.clock(), self.line()
        self.stream.write(f"{ERASE}{self.last_line}" if self.terminal else f"{self.last_line}\n")
        self.stream.flush()

    def close(self, after: StatusCounts | None = None) -> None:
        """Shows the last line, if needed, with the rows in the store ``after`` the run, also those of other shards."""
        if not self.last_line:
            return
        if after is not None:
            self.done, self.failed, self.left = after.rows, after.failed, after.left
        # On a terminal the line is repeated in its final form; elsewhere only if it has changed.
        if self.terminal or self.last_line != self.line():
            self.show()
        if self.terminal:
            self.stream.write("\n")

    def line(self) -> str:
        """Returns the line that shows the progress."""
        share = f"{100 * self.done / self.rows:.1f} %"
        left = f"{self.left:,} left the plane, " if self.left else ""
        return f"{self.done:,} of {self.rows:,} rows ({share}), {self.failed:,} failed, {left}{self._pace()}"

    def _pace(self) -> str:
        if not self.now:
            return "compiling"
        if self.now >= self.mine:
            return f"in {duration(self.last - self.start)}"
        rate = self._rate()
        if rate is None:
            return "remaining time not known before the next chunk"
        return f"{rate:,.3g} rows/s, {duration((self.mine - self.now) / rate)} to go"

    def _rate(self) -> float | None:
        """Computes the rows per second of all workers; a worker that has done only one chunk is assumed as fast as the
        others.
        """
        rows = sum(worker.rows for worker in self.workers.values())
        seconds = sum(worker.last - worker.start for worker in self.workers.values())
        if rows and seconds:
            # Seconds are summed over workers, so that rows per second and worker are multiplied by how many there
            # are.
            return len(self.workers) * rows / seconds
        if len(self.workers) > self.parallel:  # a new process for each chunk, which compiles first
            return self.now / (self.last - self.start)
        return None


class _Worker(NamedTuple):
    """When a worker's first and last chunk ended, and how many rows it did between."""

    start: float
    last: float
    rows: int

    def after(self, rows: int, last: float) -> "_Worker":
        return _Worker(self.start, last, self.rows + rows)
