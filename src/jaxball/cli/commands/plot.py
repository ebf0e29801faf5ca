"""``jaxball plot``: the figures of a saved run."""

import argparse
from pathlib import Path

from ...results.files import check_saved
from ..jax_setup import set_up_jax
from ..output import add_formats, add_quiet, add_replacing, check_figures_folder


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "plot",
        description="Draws the figures of a saved run, as `jaxball simulate --plot` does.",
    )
    parser.add_argument("saved", type=Path, metavar="RUN", help="a run that jaxball saved: .nc or .npz")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="where to write the figures, named after the run; those of another run are not replaced",
    )
    add_formats(parser, "--format")
    add_replacing(parser)
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_figures_folder(options, "out", "format")
    check_saved(options.saved)
    set_up_jax()
    from ..work.plot import run

    return run(options)
