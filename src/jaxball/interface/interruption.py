"""What Ctrl-C does.

Python raises ``KeyboardInterrupt`` wherever the main thread happens to be: inside a callback of XLA it ends the process
or is lost, while a module is imported it leaves that half imported, and during a compilation it is not raised at all.
So a command has nothing raised. The signal writes a byte into a pipe, and a thread that reads it acts at once, whatever
the main thread is doing.
"""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator

INTERRUPTED = 130
STOPPED = "Stopped."

_listening = False
_actions: list[Callable[[], object]] = []
_last_words: list[Callable[[], str]] = [lambda: STOPPED]
_stops: list[tuple[threading.Event, str]] = []


def end_at_ctrl_c() -> None:
    """Lets Ctrl-C end this process with a sentence and exit code 130; for the process of a command, and no other.

    Where Ctrl-C is ignored, as in a background job of a shell, or has another meaning, that stays.
    """
    global _listening
    if _listening or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    threading.Thread(target=_listen, args=(reading,), name="Ctrl-C", daemon=True).start()
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    signal.signal(signal.SIGINT, _raise_nothing)
    _listening = True


def end_as_it_is() -> None:
    """Lets Ctrl-C change nothing any more, because the command has done all that it does."""
    if _listening:
        ignore_ctrl_c()


@contextlib.contextmanager
def before_the_end(action: Callable[[], object]) -> Iterator[None]:
    """Calls ``action`` if Ctrl-C ends the process within, as for the removal of a half-written file.

    It runs in another thread than the rest, and must import nothing.
    """
    _actions.append(action)
    try:
        yield
    finally:
        _actions.remove(action)


@contextlib.contextmanager
def last_words(words: Callable[[], str]) -> Iterator[None]:
    """What is said if Ctrl-C ends the process within: a sentence, which is made then, and must import nothing."""
    _last_words.append(words)
    try:
        yield
    except KeyboardInterrupt as error:  # where a command is called from Python
        error.args = (words(),)
        raise
    finally:
        _last_words.pop()


@contextlib.contextmanager
def asked_to_stop(words: str = "") -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets, saying ``words`` at once; the second one ends or interrupts at once.

    Outside the main thread, where Python delivers no signals, nothing sets it but a command's Ctrl-C.
    """
    event = threading.Event()
    if _listening:
        _stops.append((event, words))
        try:
            yield event
        finally:
            _stops.pop()
        return
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is signal.SIG_IGN:
        yield event
        return

    def stop(*_) -> None:
        event.set()
        signal.signal(signal.SIGINT, before)
        if words:
            _say(words)

    signal.signal(signal.SIGINT, stop)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def heard_by_the_parent() -> Iterator[None]:
    """Processes that begin within do not hear Ctrl-C, not even while they start; this one does."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_ctrl_c() -> None:
    """Lets Ctrl-C do nothing, in a worker whose parent hears it too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _raise_nothing(*_) -> None:
    """The handler that Python calls in the main thread, some time after the other thread has acted."""


def _listen(reading: int) -> None:
    while True:
        if signal.SIGINT not in os.read(reading, 64):
            continue
        open_stops = [(event, words) for event, words in tuple(_stops) if not event.is_set()]
        if not open_stops:
            _end()
        for event, words in open_stops:
            event.set()
            _say(words)


def _end() -> None:
    for action in reversed(tuple(_actions)):
        with contextlib.suppress(Exception):
            action()
    words = STOPPED
    with contextlib.suppress(Exception):
        words = _last_words[-1]()
    _say(words)
    # Not sys.exit, which ends this thread alone; nor would the interpreter's own way out survive what XLA is doing.
    os._exit(INTERRUPTED)


def _say(words: str) -> None:
    """Past ``sys.stderr``, of which the main thread may hold the lock."""
    with contextlib.suppress(OSError):
        # On a terminal "^C" stands on the line, perhaps behind a line of progress.
        line = "\n" if os.isatty(2) else ""
        os.write(2, f"{line}jaxball: {words}\n".encode())
