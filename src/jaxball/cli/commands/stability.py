"""``jaxball stability``: the steady motions of a ball, and their linear stability."""

import argparse
from pathlib import Path

from ..input import add_scenario, scenario_document
from ..jax_setup import set_up_jax
from ..options import BadInputError, number
from ..output import add_output, check_outputs


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "stability",
        description=(
            "Finds the directions about which a ball can rest or spin in place (--rate) or its rolling in circles "
            "(--rolling), or takes the scenario's initial state (--initial), and computes the eigenvalues that decide "
            "its stability. Masses must be at rest in the body."
        ),
    )
    add_scenario(parser)
    motions = parser.add_mutually_exclusive_group()
    motions.add_argument("--rate", type=number, metavar="OMEGA", help="spin at this rate (default: 0, rest)")
    motions.add_argument(
        "--rolling", type=number, nargs=2, metavar=("INCLINATION", "PRECESSION"), help="roll in circles"
    )
    motions.add_argument("--initial", action="store_true", help="the scenario's initial state")
    parser.add_argument("--turning", type=number, metavar="RATE", help="rate at which the state of --initial turns")
    parser.add_argument("--time", type=number, metavar="T", help="the time of the schedules (default: the start)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the states and eigenvalues: .csv")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the eigenvalues: .png, .pdf or .svg")
    add_output(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_outputs(options, (".csv",))
    if options.turning is not None and not options.initial:
        raise BadInputError("Argument `--turning` is for the scenario's initial state; give --initial with it.")
    document = scenario_document(options)
    set_up_jax()
    from ..work.stability import run

    return run(options, document)
