"""``jaxball design``: searches for rails, motions and parameters with which a ball does what a problem file asks."""

import argparse
from pathlib import Path

from ...interface.output import check_folder
from ...scenario.errors import ScenarioError
from ...scenario.sources import document_of, naming, text_of
from ..jax_setup import set_up_jax


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "design",
        description="Searches for a design, or resumes one that was interrupted, for whatever reason.",
    )
    parser.add_argument("problem", metavar="FILE", help="a problem file")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder for the design and report")
    parser.add_argument("--quiet", action="store_true", help="print no progress")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_folder(options.out, "--out")
    text = text_of(options.problem, "problem file", ScenarioError)
    with naming(options.problem):
        document = document_of(text, "problem", ScenarioError)
    set_up_jax()
    from ..work.design import run

    return run(options, text, document)
