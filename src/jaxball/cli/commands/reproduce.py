"""``jaxball reproduce``: both runs of the paper, its figures and a table of errors."""

import argparse
from pathlib import Path

from ...interface.output import check_folder
from ..jax_setup import set_up_jax
from ..output import working


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("reproduce")
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="FOLDER", help="where to write (default: out)")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_folder(options.out, "--out")
    set_up_jax()
    from ...paper.reproduce import reproduce

    with working(options, "measuring and drawing") as line:
        reproduce(options.out, echo=line.print)
    return 0
