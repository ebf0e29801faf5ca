"""``jaxball periodic``: the periodic motion near a scenario's state, its Floquet multipliers, and charts of them."""

import argparse
import math
from pathlib import Path
from typing import Any

from ...scenario.paths import check_number
from ..chart import METAVAR, axes_of
from ..input import add_scenario, scenario_document
from ..jax_setup import set_up_jax
from ..options import BadInputError, count, number, positive
from ..output import add_output, check_outputs

ITERATIONS = 20


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "periodic",
        description=(
            "Finds the motion near the scenario's initial state that repeats after a period, by Newton's method, and "
            "its Floquet multipliers, the factors by which deviations change over a period: they say whether it is "
            "stable. Position and heading need not repeat where nothing depends on them, and angles only up to whole "
            "turns. Solved to 1e-11, or finer where the scenario is."
        ),
    )
    add_scenario(parser)
    period = parser.add_mutually_exclusive_group(required=True)
    period.add_argument(
        "--period",
        type=positive,
        metavar="T",
        help="the period; an approximate value is enough, unless the equations depend on time, as through a schedule",
    )
    period.add_argument(
        "--frequency",
        type=_frequency,
        metavar="OMEGA|PATH",
        help="the angular frequency 2 pi / T instead, or its path in the scenario, as in "
        "'ground.motion.free.frequency[0]'",
    )
    parser.add_argument(
        "--after",
        type=number,
        metavar="T",
        help="start from the state of the scenario's run at this time, for instance once it has settled",
    )
    parser.add_argument(
        "--turns",
        type=int,
        nargs="+",
        metavar="N",
        help="whole turns that each angle gains in a period (default: the nearest)",
    )
    parser.add_argument(
        "--iterations", type=count, metavar="N", help=f"maximum number of Newton steps (default: {ITERATIONS})"
    )
    parser.add_argument(
        "--chart",
        nargs=2,
        metavar=METAVAR,
        help="a chart instead: the growth rate of deviations over two numbers, as in 'body.offset[2]=-0.3:-0.1:20' "
        "resistance.rolling=0:0.5:20",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the numbers: .csv, or .nc for a chart")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw the multipliers, or the chart: .png, .pdf or .svg"
    )
    add_output(parser)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    for name in ("after", "turns"):
        if options.chart is not None and getattr(options, name) is not None:
            raise BadInputError(f"Argument `--{name}` is for one motion; leave it out with --chart.")
    check_outputs(options, (".csv",) if options.chart is None else (".nc", ".csv"))
    axes = None if options.chart is None else axes_of(options)
    document = scenario_document(options)
    period = _period(options, document)
    options.iterations = options.iterations or ITERATIONS
    set_up_jax()
    from ..work import periodic

    return periodic.run(options, document, period) if axes is None else periodic.chart(options, document, period, axes)


def _period(options: argparse.Namespace, document: dict[str, Any]) -> float | str:
    """The period, or the path of an angular frequency that the document has."""
    if options.period is not None:
        return options.period
    if isinstance(options.frequency, str):
        check_number(document, options.frequency)
        return options.frequency
    return 2 * math.pi / options.frequency


def _frequency(text: str) -> float | str:
    try:
        float(text)
    except ValueError:
        return text.strip()
    return positive(text)
