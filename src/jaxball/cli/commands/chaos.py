"""``jaxball chaos``: the Lyapunov exponents of a scenario, charts of the largest one, and Poincaré maps."""

import argparse
import math
from pathlib import Path

from ..chart import METAVAR, axes_of
from ..input import add_scenario, scenario_document
from ..jax_setup import set_up_jax
from ..options import BadInputError, number, positive
from ..output import add_output, check_outputs

DIRECTIONS = {"rising": 1, "falling": -1, "both": 0}


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("chaos")
    add_scenario(parser)
    parser.add_argument("--end", type=number, help="end at this time, instead of the scenario's")
    parser.add_argument("--transient", type=number, default=0.0, help="start averaging after this time (default: 0)")
    parser.add_argument(
        "--interval", type=positive, help="time between orthonormalisations (default: 1, or 10 for a chart)"
    )
    parser.add_argument("--exponents", type=int, metavar="K", help="compute only the K largest (default: all)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the numbers: .csv, or .nc for a chart")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw them: .png, .pdf or .svg")
    add_output(parser)
    kinds = parser.add_mutually_exclusive_group()
    kinds.add_argument(
        "--chart",
        nargs=2,
        metavar=METAVAR,
        help="compute a chart instead: the largest exponent over two numbers, as in 'initial.Omega[0]=0:3:30' "
        "body.mass=1:2:20",
    )
    kinds.add_argument(
        "--poincare",
        metavar="COMPONENT=VALUE",
        help="compute a Poincaré map instead: the states in which a component has a value, as in 'Omega[0]=0'",
    )
    parser.add_argument("--direction", choices=DIRECTIONS, help="direction of --poincare's crossings (default: rising)")
    parser.add_argument(
        "--axes", nargs=2, metavar="COMPONENT", help="the axes of --poincare's figure, as in 'Omega[1]' 'Gamma[2]'"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    _check_options(options)
    try:
        if options.chart is not None:
            return _chart(options)
        if options.poincare is not None:
            return _poincare(options)
        return _exponents(options)
    except ValueError as error:
        raise BadInputError(str(error)) from None


def _exponents(options: argparse.Namespace) -> int:
    check_outputs(options, (".csv",))
    document = scenario_document(options)
    set_up_jax()
    from ..work.chaos import run

    return run(options, document)


def _chart(options: argparse.Namespace) -> int:
    check_outputs(options, (".nc", ".csv"))
    if options.exponents is not None:
        raise BadInputError("Argument `--exponents` must be left out with --chart, which shows the largest one.")
    axes = axes_of(options)
    document = scenario_document(options)
    set_up_jax()
    from ..work.chaos_chart import run

    return run(options, document, axes)


def _poincare(options: argparse.Namespace) -> int:
    check_outputs(options, (".csv", ".npz"))
    path, value = _section(options.poincare)
    document = scenario_document(options)
    set_up_jax()
    from ..work.poincare import run

    return run(options, document, path, value)


def _check_options(options: argparse.Namespace) -> None:
    """Raises a :class:`BadInputError` for options that cannot be combined."""
    for name in ("direction", "axes"):
        if getattr(options, name) is not None and options.poincare is None:
            raise BadInputError(f"Argument `--{name}` is for a Poincaré map; give --poincare COMPONENT=VALUE with it.")
    for name in ("exponents", "interval"):
        if options.poincare is not None and getattr(options, name) is not None:
            raise BadInputError(f"Argument `--{name}` is for Lyapunov exponents; leave it out with --poincare.")
    if options.poincare is not None and options.transient:
        raise BadInputError("Argument `--transient` is for Lyapunov exponents; leave it out with --poincare.")


def _section(text: str) -> tuple[str, float]:
    path, equals, value = text.partition("=")
    try:
        number = float(value) if equals else math.nan
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise BadInputError(
            f"Argument `--poincare` must be COMPONENT=VALUE, such as 'Omega[0]=0', but it is \"{text}\"."
        )
    return path.strip(), number
