"""``jaxball reproduce``: both runs of the paper, its figures and a table of errors."""

import argparse
from pathlib import Path

from ..results import OutputError


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("reproduce", help="reproduce both runs of Putkaradze & Rogers (2018)")
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="FOLDER", help="where to (default: out)")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    # Imported here, because matplotlib takes longer to import than the other commands need.
    from ..reproduce import reproduce

    if options.out.exists() and not options.out.is_dir():
        raise OutputError(f'Argument `--out` must be a folder, but "{options.out}" is a file.')
    reproduce(options.out)
    return 0
