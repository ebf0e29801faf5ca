"""``jaxball chaos``: the Lyapunov exponents of a scenario."""

import argparse
import sys
from pathlib import Path
from typing import Any

from ..chaos import lyapunov_spectrum
from ..output import check_destination, replacing
from ..scenario import load_scenario
from ..scenario.solve import SOLVERS
from .options import FAILED_SOLVE, BadInputError, number, positive

FIGURES = (".png", ".pdf", ".svg")


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("chaos")
    parser.add_argument("scenario", metavar="FILE|NAME", help="a scenario file, or a built-in scenario")
    parser.add_argument("--end", type=number, help="the time at which to end, instead of the scenario's")
    parser.add_argument("--transient", type=number, default=0.0, help="the time before averages begin (default: 0)")
    parser.add_argument("--interval", type=positive, default=1.0, help="between orthonormalisations (default: 1)")
    parser.add_argument("--exponents", type=int, metavar="K", help="how many, from the largest on (default: all)")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw how they converge: .png, .pdf or .svg")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    if options.plot is not None:
        check_destination(options.plot, FIGURES, "--plot")
    scenario = load_scenario(options.scenario)
    end = scenario.times[-1] if options.end is None else options.end
    if end <= scenario.times[0]:
        raise BadInputError(f"Argument `--end` must be after the start, {scenario.times[0]:g}, but it is {end:g}.")
    try:
        spectrum = lyapunov_spectrum(
            scenario.system,
            (scenario.times[0], end),
            scenario.state,
            exponents=options.exponents,
            transient=options.transient,
            interval=options.interval,
            solver=SOLVERS[scenario.solver](),
            rtol=scenario.rtol,
            atol=scenario.atol,
        )
    except ValueError as error:
        raise BadInputError(str(error)) from None
    if not spectrum.ok:
        print(f"jaxball: {spectrum.message}", file=sys.stderr)
        return FAILED_SOLVE
    print(f"{scenario.title}\n{spectrum}" if scenario.title else spectrum)
    if options.plot is not None:
        # Imported here, because matplotlib takes longer to import than the exponents take.
        from .. import plot

        with replacing(options.plot) as beside:
            figure: Any = plot.lyapunov_convergence(spectrum).figure
            plot.caption(figure, scenario.system, scenario.title)
            figure.savefig(beside, dpi=200)
        print(f"  written: {options.plot}")
    return 0
