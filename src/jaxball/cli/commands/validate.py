"""``jaxball validate``: lists everything that is wrong with files, without running them."""

import argparse
import sys
from pathlib import Path
from typing import Any

from ...scenario.errors import ScenarioError, all_problems
from ...scenario.sources import builtin_scenarios, builtin_text, document_of, text_of
from ..input import input_text, source_name
from ..jax_setup import set_up_jax
from ..options import BAD_INPUT
from ..sentences import sentence

WHAT = "scenario, study or problem"


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "validate",
        description=(
            "Reads scenarios, studies and problems, recognised by their keys, and lists everything that is wrong. "
            "Nothing is simulated. The exit code is 2 if a file is not valid."
        ),
    )
    parser.add_argument("files", nargs="+", metavar="FILE", help="a file, a built-in scenario, or - for standard input")
    parser.add_argument("--quiet", action="store_true", help="print nothing about valid files")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    all_valid = True
    for source in options.files:
        description = ""
        with all_problems() as problems:
            description = _described(source, options)
        name = source_name(source)
        for problem in problems:
            print(f"{name}: {sentence(problem)}", file=sys.stderr)
        if not problems and not options.quiet:
            print(f"{name} is valid: {description}", flush=True)
        all_valid &= not problems
    return 0 if all_valid else BAD_INPUT


def _described(source: str, options: argparse.Namespace) -> str:
    """The contents of a file, in one line.

    **Raises:** :class:`~jaxball.ScenarioError` for a file that is not valid.
    """
    document = _document(source)
    set_up_jax()
    from ..work.validate import described

    return described(document, Path(source).parent)


def _document(source: str) -> dict[str, Any]:
    if source in builtin_scenarios():
        return document_of(builtin_text(source), "scenario", ScenarioError)
    text = input_text(source)
    text = text_of(source, WHAT, ScenarioError) if text is None else text
    return document_of(text, WHAT, ScenarioError)
