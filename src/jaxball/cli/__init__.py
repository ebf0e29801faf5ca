"""The command line: ``jaxball`` and its commands, one a file in ``commands``."""

import io
import sys
from collections.abc import Sequence

from ..interface import interruption


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command, and returns its exit code.

    0, 1 for a run that is not to be believed, 2 for bad input, 3 for a solve that failed, 130 for Ctrl-C, 141 where
    nobody reads the output any more.

    Without ``arguments`` the command is that of the process, which Ctrl-C then ends at once. Called from Python with
    ``arguments`` it leaves signals as they are.
    """
    own = arguments is None
    if own:
        interruption.end_at_ctrl_c()
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(line_buffering=True)  # so that no line is lost
    # Imported here, because Ctrl-C is to be heard before anything that takes time.
    from .dispatch import run

    code = run(sys.argv[1:] if arguments is None else arguments)
    if own:
        interruption.end_as_it_is()
    return code
