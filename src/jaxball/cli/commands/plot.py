"""``jaxball plot``: the figures of a saved run."""

import argparse
from pathlib import Path

from ...results import load_run, saved_scenario
from ..output import add_formats, add_quiet, check_figures_folder, draw_figures


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "plot",
        description="Draws the figures of a saved run, the same as `jaxball simulate --plot` draws.",
    )
    parser.add_argument("saved", metavar="RUN", help="a run that jaxball saved: .nc or .npz")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="where the figures go")
    add_formats(parser, "--format")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_figures_folder(options, "out", "format")
    run = load_run(options.saved)
    written = draw_figures(run, options.out, options.format, saved_scenario(options.saved).title)
    if not options.quiet:
        print(f"{run}\n  written: {written}")
    return 0
