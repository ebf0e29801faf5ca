"""``jaxball view``: a saved run as one HTML file."""

import argparse
from pathlib import Path

from ...interface.views import check_view
from ...results.files import check_saved
from ..jax_setup import set_up_jax
from ..options import positive
from ..output import add_quiet


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "view",
        description="Writes a saved run as one HTML file, the same as `jaxball simulate --view` writes: the body in "
        "three dimensions, played or stepped through, with graphs over time. It needs no network.",
    )
    parser.add_argument("saved", type=Path, metavar="RUN", help="a run that jaxball saved: .nc or .npz")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="where the view goes: .html")
    parser.add_argument("--friction", type=positive, metavar="MU", help="draw the cone of this coefficient of friction")
    add_quiet(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_view(options.out, "--out")
    check_saved(options.saved)
    set_up_jax()
    from ..work.view import run

    return run(options)
