"""``jaxball reproduce``: both runs of the paper, its figures and a table of errors, or a comparison of solvers."""

import argparse
from pathlib import Path

from ...interface.output import check_folder
from ..jax_setup import set_up_jax
from ..options import working


def add(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="FOLDER", help="where to write (default: out)")
    parser.add_argument(
        "--solvers",
        action="store_true",
        help="instead of figures, a table of every solver that the paper names and its counterpart in jaxball: steps, "
        "evaluations, error and time; takes three or four minutes",
    )


def run(options: argparse.Namespace) -> int:
    check_folder(options.out, "--out")
    set_up_jax()
    from ...paper.reproduce import compare_solvers, reproduce

    doing, report = ("measuring", compare_solvers) if options.solvers else ("measuring and drawing", reproduce)
    with working(options, doing) as line:
        report(options.out, echo=line.print)
    return 0
