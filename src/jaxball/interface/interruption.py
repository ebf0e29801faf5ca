"""What Ctrl-C does.

Python raises ``KeyboardInterrupt`` wherever the main thread happens to be: in a callback of XLA it kills the process or
is lost, during an import it leaves a module half imported, and during a compilation it is not raised at all. So in a
command nothing is raised: the signal writes a byte into a pipe, and a thread that reads the pipe acts at once, whatever
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
_messages: list[Callable[[], str]] = [lambda: STOPPED]
_stops: list[tuple[threading.Event, str]] = []


def end_at_ctrl_c() -> None:
    """Makes Ctrl-C end this process with a sentence and exit code 130; only for the process of a command.

    A process that ignores Ctrl-C, as a shell's background job does, or that handles it itself stays as it is.
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


def stop_listening() -> None:
    """Makes Ctrl-C change nothing any more, because the command has finished."""
    if _listening:
        ignore_ctrl_c()


@contextlib.contextmanager
def on_interrupt(action: Callable[[], object]) -> Iterator[None]:
    """Calls ``action``, such as the removal of a half-written file, if Ctrl-C ends the process in this block.

    It runs in a thread of its own and must import nothing.
    """
    _actions.append(action)
    try:
        yield
    finally:
        _actions.remove(action)


@contextlib.contextmanager
def interrupt_message(message: Callable[[], str]) -> Iterator[None]:
    """Prints ``message()`` if Ctrl-C ends the process in this block; it is called then and must import nothing."""
    _messages.append(message)
    try:
        yield
    except KeyboardInterrupt as error:  # where a command is called from Python
        error.args = (message(),)
        raise
    finally:
        _messages.pop()


@contextlib.contextmanager
def stop_requested(message: str = "") -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets, printing ``message``; the second one ends or interrupts at once.

    Outside the main thread, where Python delivers no signals, only a command's Ctrl-C sets it.
    """
    event = threading.Event()
    if _listening:
        _stops.append((event, message))
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
        if message:
            _say(message)

    signal.signal(signal.SIGINT, stop)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def blocked_in_children() -> Iterator[None]:
    """Processes that start in this block do not receive Ctrl-C, not even while they start; this one does."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_ctrl_c() -> None:
    """Makes Ctrl-C do nothing, in a worker whose parent receives it too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _raise_nothing(*_) -> None:
    """The handler that Python calls in the main thread, some time after the listening thread has acted."""


def _listen(reading: int) -> None:
    while True:
        if signal.SIGINT not in os.read(reading, 64):
            continue
        pending = [(event, message) for event, message in tuple(_stops) if not event.is_set()]
        if not pending:
            _end()
        for event, message in pending:
            event.set()
            _say(message)


def _end() -> None:
    for action in reversed(tuple(_actions)):
        with contextlib.suppress(Exception):
            action()
    message = STOPPED
    with contextlib.suppress(Exception):
        message = _messages[-1]()
    _say(message)
    # Not sys.exit, which ends only this thread; and the interpreter's orderly exit does not survive a busy XLA.
    os._exit(INTERRUPTED)


def _say(message: str) -> None:
    """Writes to the descriptor, because the main thread may hold the lock of ``sys.stderr``."""
    with contextlib.suppress(OSError):
        # On a terminal "^C" is on the current line, perhaps behind a line of progress.
        line = "\n" if os.isatty(2) else ""
        os.write(2, f"{line}jaxball: {message}\n".encode())
