"""The progress line of a study."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

from ..interface.activity import ERASE
from .chunk import Done
from .tally import Tally

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
        before: Tally,
        mine: int,
        parallel: int = 1,
        clock: Callable[[], float] = time.monotonic,
    ):
        """``rows`` in all, those in the store ``before``, and ``mine`` to be done now by ``parallel`` workers."""
        self.stream, self.rows, self.mine, self.parallel, self.clock = stream, rows, mine, parallel, clock
        self.done, self.failed, self.now = before.rows, before.failed, 0
        self.workers: dict[str, _Worker] = {}
        self.start = self.shown = self.last = clock()
        self.terminal, self.told = stream.isatty(), ""
        if mine:
            self.show()

    def add(self, chunk: Done) -> None:
        """Counts the rows of a chunk that was done, and shows it from time to time."""
        self.now += chunk.rows
        self.done += chunk.rows
        self.failed += chunk.failed
        self.last = self.clock()
        seen = self.workers.get(chunk.worker)
        now = _Worker(self.last, self.last, 0) if seen is None else seen.after(chunk.rows, self.last)
        self.workers[chunk.worker] = now
        passed = self.last - self.shown
        if passed > (SECONDS_BETWEEN_CHANGES if self.terminal else SECONDS_BETWEEN_LINES):
            self.show()

    def show(self) -> None:
        """Shows the line now."""
        self.shown, self.told = self.clock(), self.line()
        self.stream.write(f"{ERASE}{self.told}" if self.terminal else f"{self.told}\n")
        self.stream.flush()

    def close(self, after: Tally | None = None) -> None:
        """Shows the last line, if needed, with the rows in the store ``after`` the run, also those of other shards."""
        if not self.told:
            return
        if after is not None:
            self.done, self.failed = after.rows, after.failed
        if self.terminal or self.told != self.line():
            self.show()
        if self.terminal:
            self.stream.write("\n")

    def line(self) -> str:
        """The line."""
        share = f"{100 * self.done / self.rows:.1f} %"
        return f"{self.done:,} of {self.rows:,} rows ({share}), {self.failed:,} failed, {self._pace()}"

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
        """Rows per second of all workers; those that have done one chunk are assumed as fast as the others."""
        rows = sum(worker.rows for worker in self.workers.values())
        seconds = sum(worker.last - worker.start for worker in self.workers.values())
        if rows and seconds:
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


def duration(seconds: float) -> str:
    """A duration as text: ``42 s``, ``5 min``, ``3.2 h``."""
    if seconds < 100:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
