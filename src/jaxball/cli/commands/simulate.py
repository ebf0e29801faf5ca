"""``jaxball simulate``: simulates, saves and draws a scenario."""

import argparse
from pathlib import Path

from ...interface.output import check_destination
from ...interface.views import check_view
from ...results.files import SUFFIXES
from ...scenario.solvers import SOLVERS
from ..animation import add_animation, check_animation
from ..input import add_scenario, scenario_document
from ..jax_setup import set_up_jax
from ..options import number, positive
from ..output import add_formats, add_output, add_replacing, check_figures_folder, check_json


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("simulate")
    add_scenario(parser)
    parser.add_argument("--end", type=number, metavar="T", help="end at this time, instead of the scenario's")
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the trajectory: .nc, .npz or .csv")
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="FOLDER",
        help="draw the figures into this folder, named after the scenario; those of another run are not replaced",
    )
    add_formats(parser, "--plot-format")
    add_replacing(parser)
    parser.add_argument("--view", type=Path, metavar="FILE", help="show the run in one HTML file: .html")
    add_animation(parser)
    parser.add_argument(
        "--solver", choices=SOLVERS, metavar="SOLVER", help=f"instead of the scenario's: one of {', '.join(SOLVERS)}"
    )
    parser.add_argument("--rtol", type=positive, help="relative tolerance, instead of the scenario's")
    parser.add_argument("--atol", type=positive, help="absolute tolerance, instead of the scenario's")
    parser.add_argument(
        "--contact",
        metavar="LAW",
        help="let the body slip and fly, with this kinetic coefficient of friction, as in 0.3, or with these keys of "
        "[contact], as in sliding=0.3,static=0.4,restitution=0.5; replaces the scenario's law",
    )
    parser.add_argument("--friction", type=positive, metavar="MU", help="end where rolling needs more friction than MU")
    parser.add_argument("--detachment", action="store_true", help="end where the ball would leave the plane")
    add_output(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_json(options)
    if options.out is not None:
        check_destination(options.out, SUFFIXES, "--out")
    check_figures_folder(options, "plot", "plot_format")
    if options.view is not None:
        check_view(options.view, "--view")
    check_animation(options)
    document = scenario_document(options, options.end)
    set_up_jax()
    from ..work.simulate import run

    return run(options, document)
