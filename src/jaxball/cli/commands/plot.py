"""``jaxball plot``: the figures of a saved run."""

import argparse
from pathlib import Path

from ...files.results.files import check_saved
from ..input import refuse_document
from ..jax_setup import set_up_jax
from ..options import (
    add_formats,
    add_quiet,
    add_replacing,
    check_figures_folder,
    name_files,
    say,
    working,
)


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = "Draws the figures of a saved run, like `jaxball simulate --plot`."
    parser.add_argument("saved", type=Path, metavar="RUN", help="a saved run: .nc or .npz")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="draw the figures into this folder, named after the run; those of another run are not replaced",
    )
    add_formats(parser, "--format")
    add_replacing(parser)
    add_quiet(parser)


def run(options: argparse.Namespace) -> int:
    check_figures_folder(options, "out", "format")
    refuse_document(options.saved)
    check_saved(options.saved)
    set_up_jax()
    from ...files.results import saved_scenario
    from ...files.results.loading import load_run
    from ...programs.program import compile_quickly
    from ..files import draw_figures

    with working(options, "drawing"), compile_quickly():
        run = load_run(options.saved)
        written = draw_figures(options, run, options.out, options.format, saved_scenario(options.saved), options.saved)
    say(options, run, name_files([written]))
    return 0
