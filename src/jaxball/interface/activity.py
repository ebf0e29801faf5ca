"""A line that says what a command is doing, or that Python waits for a compilation, on a terminal or in a notebook.

Nothing is written to a log.
"""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any, TextIO

DELAY = 0.5  # in seconds; anything shorter is not worth a line
BETWEEN_CHANGES = 0.1  # in seconds
TICK = 1.0  # seconds after which a line says how long it has been the same
ERASE = "\r\x1b[K"

_compilations: list[None] = []  # one for each thread that compiles
_activities: list[None] = []  # of commands


@contextlib.contextmanager
def activity(text: str, *, quiet: bool = False) -> Iterator["Line"]:
    """Shows ``text`` on standard error while this block runs, after half a second, and erases it at the end.

    While the text stays the same, the seconds are counted. Nothing is shown if standard error is not a terminal, or if
    ``quiet``. Anything printed meanwhile must be printed through the line, which makes room for it.
    """
    _activities.append(None)
    try:
        with _keep_shown(Line(text, None if quiet or not _is_terminal(sys.stderr) else sys.stderr), DELAY) as line:
            yield line
    finally:
        _activities.pop()


@contextlib.contextmanager
def _keep_shown(line: "Line", delay: float) -> Iterator["Line"]:
    """Shows a line after ``delay`` seconds, keeps it up to date, and erases it at the end."""
    done = threading.Event()

    def keep_up_to_date() -> None:
        wait = delay
        while not done.wait(wait):
            line.show()
            wait = TICK - line.age % TICK

    # A thread, because the main one compiles, for seconds without a pause.
    threading.Thread(target=keep_up_to_date, daemon=True).start()
    try:
        yield line
    finally:
        done.set()
        line.close()


class Line:
    """The line of an activity on ``stream``, which is None where nothing is to be shown."""

    def __init__(self, text: str, stream: TextIO | None, begun: float | None = None):
        self._text, self._stream, self._lock = text, stream, threading.Lock()
        self._shown = self._closed = False
        # When the line was written, and when its text was new.
        self._written, self._begun = 0.0, time.monotonic() if begun is None else begun

    @property
    def age(self) -> float:
        """The seconds for which the text has been the same."""
        return time.monotonic() - self._begun

    def show(self) -> None:
        """Shows the line, unless it is closed."""
        with self._lock:
            if self._stream is not None and not self._closed:
                self._write(f"{ERASE}{self._whole()}"[: len(ERASE) + _width(self._stream) - 1])
                self._shown, self._written = True, time.monotonic()

    def change(self, text: str) -> None:
        """Shows another text, at most a few times a second."""
        if text != self._text:
            self._text, self._begun = text, time.monotonic()
        if self._shown and time.monotonic() - self._written > BETWEEN_CHANGES:
            self.show()

    def print(self, text: object, file: Any = None) -> None:
        """Prints above the line."""
        shown = self._shown
        self._erase()
        print(text, file=file, flush=True)
        if shown:
            self.show()

    def close(self) -> None:
        """Erases the line for good."""
        self._closed = True
        self._erase()

    def _whole(self) -> str:
        doing = f"{self._text} (compiling)" if _compilations else self._text
        return f"{doing} …, {self.age:.0f} s" if self.age >= TICK else f"{doing} …"

    def _erase(self) -> None:
        with self._lock:
            if self._shown:
                self._write(ERASE)
            self._shown = False

    def _write(self, text: str) -> None:
        if self._stream is not None:
            with contextlib.suppress(OSError):
                self._stream.write(text)
                self._stream.flush()


def _is_terminal(stream: Any) -> bool:
    return stream is not None and stream.isatty()


def _width(stream: TextIO) -> int:
    with contextlib.suppress(OSError):
        return os.get_terminal_size(stream.fileno()).columns or 80
    return 80


FIRST_CALL = "jaxball: the first call of its kind"
SILENCE = 5.0  # in seconds, after which Python says that it compiles
PAUSE = 1.0  # in seconds, between two compilations for which one waits as if they were one


class _Wait:
    """When compilations of this process, with at most short pauses, began, and when the last of them ended."""

    begun = ended = -PAUSE


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Marks a block that traces or compiles a program; blocks may be within each other, and in several threads.

    Outside of commands, which say what they are doing, a line says so after five seconds on a terminal or in a
    notebook.
    """
    stream = sys.stderr if _is_terminal(sys.stderr) or _is_of_notebook(sys.stderr) else None
    says = stream is not None and not _activities and not _compilations
    _compilations.append(None)
    try:
        with contextlib.ExitStack() as stack:
            if says:
                now = time.monotonic()
                _Wait.begun = now if now - _Wait.ended > PAUSE else _Wait.begun
                line = Line(FIRST_CALL, stream, _Wait.begun)
                stack.enter_context(_keep_shown(line, max(SILENCE - line.age, 0.0)))
            yield
    finally:
        _compilations.pop()
        _Wait.ended = time.monotonic()


def _is_of_notebook(stream: Any) -> bool:
    return type(stream).__module__.startswith("ipykernel.")
