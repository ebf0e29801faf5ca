"""``jaxball reproduce``: both runs of the paper, its figures and a table of errors."""

import argparse
from pathlib import Path

from ...interface.output import check_folder


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("reproduce")
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="FOLDER", help="where to write (default: out)")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    # Imported here, because matplotlib takes longer to import than the other commands need.
    from ...paper.reproduce import reproduce

    check_folder(options.out, "--out")
    reproduce(options.out)
    return 0
