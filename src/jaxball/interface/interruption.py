"""Handles Ctrl-C, SIGTERM (by which schedulers stop a job) and SIGHUP (sent when a terminal closes).

The command line switches it on; whatever must clean up when a signal ends the process says so here.

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

from .starting import STOPPED, say

SECONDS_FOR_THE_MAIN_THREAD = 0.2
# What each signal does by default, and how it is sent again.
_HANDLED = {
    signal.SIGINT: (signal.default_int_handler, "press Ctrl-C again"),
    signal.SIGTERM: (signal.SIG_DFL, "send SIGTERM again"),
}
if hasattr(signal, "SIGHUP"):  # Windows has none
    _HANDLED[signal.SIGHUP] = (signal.SIG_DFL, "send SIGHUP again")

_heard: set[int] = set()
_received = signal.SIGINT
_ending, _main_thread_waits = threading.Event(), threading.Event()
_actions: list[Callable[[], object]] = []
_messages: list[Callable[[], str]] = [lambda: STOPPED]
_stops: list[tuple[threading.Event, str]] = []


def end_at_signals() -> None:
    """Makes Ctrl-C, SIGTERM and SIGHUP end this process with a sentence and exit code 130, 143 or 129.

    Only for the process of a command. Signals that it already ignores, such as Ctrl-C in a shell's background job and
    SIGHUP under ``nohup``, or handles itself stay as they are.
    """
    if _heard:
        return
    _heard.update(number for number, (default, _) in _HANDLED.items() if signal.getsignal(number) is default)
    if not _heard:
        return
    reading, writing = os.pipe()
    if hasattr(os, "set_blocking"):  # Windows has it from Python 3.12 on, and does not ask for it
        os.set_blocking(writing, False)
    threading.Thread(target=_listen, args=(reading,), name="signals", daemon=True).start()
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for number in _heard:
        signal.signal(number, _in_the_main_thread)


def stop_listening() -> None:
    """Makes the signals have no further effect, because the command has finished."""
    for number in _heard:
        signal.signal(number, signal.SIG_IGN)


def exit_code() -> int:
    """Returns the exit code of a command that a signal has stopped."""
    return 128 + _received


@contextlib.contextmanager
def on_interrupt(action: Callable[[], object]) -> Iterator[None]:
    """Calls ``action``, such as the removal of a half-written file, if a signal ends the process in this block.

    It runs in a thread of its own and must import nothing.
    """
    _actions.append(action)
    try:
        yield
    finally:
        _actions.remove(action)


@contextlib.contextmanager
def interrupt_message(message: Callable[[], str]) -> Iterator[None]:
    """Prints ``message()`` if a signal ends the process in this block; it is called then and must import nothing."""
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
    """Yields an event that the first signal sets, printing ``message``; the second one ends or interrupts at once.

    In the message, ``{again}`` says how to send the second one. In Python the only signal is Ctrl-C; outside the main
    thread, where Python delivers none, only the signals of a command set the event.
    """
    event = threading.Event()
    if _heard:
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
        _say_stopping(message, signal.SIGINT)

    signal.signal(signal.SIGINT, stop)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def block_in_children() -> Iterator[None]:
    """Blocks the signals in processes that start in this block, even while they start; this one receives them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _HANDLED)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def leave_to_parent() -> None:
    """Makes a worker ignore the signals, which its parent receives too."""
    for number in _HANDLED:
        signal.signal(number, signal.SIG_IGN)


def _in_the_main_thread(*_) -> None:
    """Handles a signal when Python calls it in the main thread, some time after the listening thread has acted."""
    if _ending.is_set():
        _main_thread_waits.set()
        threading.Event().wait()


def _listen(reading: int) -> None:
    global _received
    while True:
        numbers = [number for number in os.read(reading, 64) if number in _heard]
        if not numbers:
            continue
        _received = numbers[-1]
        pending = [(event, message) for event, message in tuple(_stops) if not event.is_set()]
        if not pending:
            _end()
        for event, message in pending:
            event.set()
            _say_stopping(message, _received)


def _end() -> None:
    # Otherwise the main thread might create again a file that an action has just removed.
    _ending.set()
    signal.raise_signal(_received)
    _main_thread_waits.wait(SECONDS_FOR_THE_MAIN_THREAD)
    for action in reversed(tuple(_actions)):
        with contextlib.suppress(Exception):
            action()
    message = STOPPED
    with contextlib.suppress(Exception):
        message = _messages[-1]()
    say(message)
    # Not sys.exit, which ends only this thread; and the interpreter's orderly exit does not survive a busy XLA.
    os._exit(exit_code())


def _say_stopping(message: str, number: int) -> None:
    if message:
        say(message.format(again=_HANDLED[signal.Signals(number)][1]))
