"""The command line ``jaxball``: its entry point :func:`main`, and its commands, one per file in ``commands``."""

import gc
import io
import sys
from collections.abc import Callable, Sequence

from ..interface import interruption

TYPE_CHECKING = False  # type checkers know the name; the module that has it takes time

if TYPE_CHECKING:
    import argparse

MANY_OBJECTS = 50_000


def main(
    arguments: Sequence[str] | None = None,
    parser: "Callable[[Sequence[str]], argparse.ArgumentParser] | None" = None,
) -> int:
    """Runs a command, and returns its exit code.

    0 for success, 1 for a run that fails verification or a design that violates a constraint, 2 for bad input, 3 for a
    solve that failed, 130 for Ctrl-C, 143 for SIGTERM, 129 for SIGHUP, 141 when the reader of the output has gone away.

    Without ``arguments``, the command is that of the process, and signals end it at once. Called from Python with
    ``arguments``, it leaves signals as they are. ``parser`` makes the parser of another program's arguments.
    """
    of_process = arguments is None
    if of_process:
        interruption.end_at_signals()
        if isinstance(sys.stdout, io.TextIOWrapper):
            # So that no line is lost, and file names that are not valid text can be printed.
            sys.stdout.reconfigure(line_buffering=True, errors="surrogateescape")
        # What a command imports and traces stays until it ends, so the garbage collector need not scan it each time and
        # at the end, which together would take as long as importing JAX.
        gc.set_threshold(MANY_OBJECTS)
    # Imported here, so that signals are handled before anything that takes time.
    from .dispatch import parser_of, run

    code = run(sys.argv[1:] if arguments is None else arguments, parser or parser_of)
    if of_process:
        interruption.stop_listening()
        gc.freeze()
    return code
