"""``jaxball verify``: the laws of mechanics, checked on runs of scenarios."""

import argparse
from pathlib import Path

from ...interface.output import check_destination
from ...scenario.sources import builtin_scenarios
from ...verify.laws import LAWS
from ..input import named_document
from ..jax_setup import set_up_jax
from ..options import BadInputError
from ..output import FIGURE_SUFFIXES, add_json, check_json


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "verify",
        description="Runs scenarios and checks every law that applies. A saved run is compared with a new run of the "
        "scenario in its file. The exit code is 1 if a run fails verification.",
        epilog="Laws: " + "; ".join(f"{name}: {what}" for name, what in LAWS.items()) + ".",
    )
    parser.add_argument(
        "scenarios",
        nargs="*",
        metavar="FILE|NAME",
        help="scenario files, built-in scenarios (default: all of those), saved runs (.nc or .npz), or -",
    )
    parser.add_argument("--laws", nargs="+", metavar="LAW", help="only these (default: all)")
    parser.add_argument("--quick", action="store_true", help="skip checks that need another solver to be compiled")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw the residuals of a run over time: .png, .pdf or .svg"
    )
    add_json(parser, "the reports")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_json(options)
    if options.plot is not None:
        check_destination(options.plot, FIGURE_SUFFIXES, "--plot")
        if len(options.scenarios) != 1:
            raise BadInputError(
                "Argument `--plot` draws the residuals of one run; give one scenario or saved run with it."
            )
    # All are read before the first run, so that a misspelt name is not discovered after minutes.
    documents = {name: named_document(name) for name in options.scenarios or builtin_scenarios()}
    set_up_jax()
    from ..work.verify import run

    return run(options, documents)
