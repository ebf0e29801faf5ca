"""A line that says how far a study has come."""

import time
from typing import Any, Protocol, runtime_checkable

SECONDS_BETWEEN_LINES = 30.0
SECONDS_BETWEEN_CHANGES = 0.2


@runtime_checkable
class Stream(Protocol):
    """What a line can be shown on, as ``sys.stderr``."""

    def write(self, text: str, /) -> Any: ...

    def flush(self) -> None: ...

    def isatty(self) -> bool: ...


class Progress:
    """Rows done of all, their rate, the time to go, and failures; on one line of a terminal, else line by line."""

    def __init__(self, stream: Stream, rows: int, done: int, mine: int):
        """``rows`` in all, ``done`` before, and ``mine`` that are to be done now."""
        self.stream, self.rows, self.done, self.mine = stream, rows, done, mine
        self.now, self.told, self.failed = 0, 0, 0
        self.start, self.shown = time.monotonic(), 0.0
        self.terminal = stream.isatty()

    def add(self, rows: int, failed: int) -> None:
        """Counts rows that were done, and shows it from time to time."""
        self.now += rows
        self.failed += failed
        passed = time.monotonic() - self.shown
        if passed > (SECONDS_BETWEEN_CHANGES if self.terminal else SECONDS_BETWEEN_LINES):
            self.show()

    def show(self) -> None:
        """Shows the line now."""
        self.shown, self.told = time.monotonic(), self.now
        self.stream.write(f"\r\x1b[K{self.line()}" if self.terminal else f"{self.line()}\n")
        self.stream.flush()

    def close(self) -> None:
        """Shows the last line, if there is one to show."""
        if self.now:
            if self.terminal or self.told != self.now:
                self.show()
            if self.terminal:
                self.stream.write("\n")

    def line(self) -> str:
        """The line."""
        done, rate = self.done + self.now, self.now / max(time.monotonic() - self.start, 1e-9)
        left = duration((self.mine - self.now) / rate) if self.now else "?"
        return (
            f"{done:,} of {self.rows:,} rows ({100 * done / self.rows:.1f} %), {rate:,.3g} rows/s, "
            f"{left} to go, {self.failed:,} failed"
        )


def duration(seconds: float) -> str:
    """A time in words: ``42 s``, ``5 min``, ``3.2 h``."""
    if seconds < 100:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
