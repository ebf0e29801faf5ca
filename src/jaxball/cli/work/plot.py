"""The figures of a saved run."""

import argparse

from ...numerics.programs import compiled_quickly
from ...results import load_run, saved_scenario
from ..output import working
from .files import draw_figures


def run(options: argparse.Namespace) -> int:
    """Draws the figures, and prints a summary of the run."""
    with working(options, "drawing"), compiled_quickly():
        run = load_run(options.saved)
        written = draw_figures(options, run, options.out, options.format, saved_scenario(options.saved), options.saved)
    if not options.quiet:
        print(f"{run}\n  written: {written}")
    return 0
