"""Ctrl-C while a command is still being imported, before :mod:`.interruption` can listen.

It is the first that a command runs, so it imports only what Python has loaded already. A Ctrl-C that comes earlier,
while Python itself starts, is answered by Python.
"""

import os
import sys

EXIT_INTERRUPTED = 130
STOPPED = "Stopped."


def _is_the_command() -> bool:
    """Says whether this process was started as ``jaxball`` or ``python -m jaxball``."""
    script = os.path.splitext(os.path.basename(sys.argv[0] if sys.argv else ""))[0]
    # While Python looks for what it runs by "-m", the script is "-m".
    return script == "jaxball" or (script == "-m" and " -m jaxball " in f" {' '.join(sys.orig_argv)} ")


def end_without_traceback() -> None:
    """Makes a Ctrl-C that Python raises as an exception end the process of a command with a sentence and exit code 130.

    Any other process that imports jaxball keeps its own ways.
    """
    if not _is_the_command():
        return
    show = sys.excepthook

    def show_unless_interrupted(kind, error, traceback) -> None:
        if not issubclass(kind, KeyboardInterrupt):
            show(kind, error, traceback)
            return
        say(STOPPED)
        os._exit(EXIT_INTERRUPTED)

    sys.excepthook = show_unless_interrupted


def say(message: str) -> None:
    """Writes to the descriptor, because the main thread may hold the lock of ``sys.stderr``."""
    # On a terminal "^C" is on the current line, perhaps behind a line of progress.
    line = "\n" if os.isatty(2) else ""
    try:  # noqa: SIM105 - contextlib is not imported yet
        os.write(2, f"{line}jaxball: {message}\n".encode(errors="surrogateescape"))
    except OSError:  # nobody reads it
        pass
