"""``jaxball chaos``: the Lyapunov exponents of a scenario, charts of the largest one, and Poincaré maps."""

import argparse
import sys
from pathlib import Path

import numpy as np

from ...chaos import LyapunovSpectrum, lyapunov_spectrum
from ...scenario import Scenario
from ...scenario.solve import SOLVERS
from .. import chaos_chart, poincare
from ..input import add_scenario, scenario_of
from ..options import FAILED_SOLVE, BadInputError, number, positive
from ..output import add_output, check_outputs, say, write_csv, write_json, write_outputs


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("chaos")
    add_scenario(parser)
    parser.add_argument("--end", type=number, help="the time at which to end, instead of the scenario's")
    parser.add_argument("--transient", type=number, default=0.0, help="the time before averages begin (default: 0)")
    parser.add_argument(
        "--interval", type=positive, help="between orthonormalisations (default: 1, and 10 for a chart)"
    )
    parser.add_argument("--exponents", type=int, metavar="K", help="compute only the K largest (default: all)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the numbers: .csv, or .nc for a chart")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw them: .png, .pdf or .svg")
    add_output(parser)
    kinds = parser.add_mutually_exclusive_group()
    chaos_chart.add_options(parser, kinds)
    poincare.add_options(parser, kinds)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    poincare.check_options(options)
    try:
        if options.chart is not None:
            return chaos_chart.run(options)
        if options.poincare is not None:
            return poincare.run(options)
        return _exponents(options)
    except ValueError as error:
        raise BadInputError(str(error)) from None


def _exponents(options: argparse.Namespace) -> int:
    check_outputs(options, (".csv",))
    scenario = scenario_of(options)
    end = scenario.times[-1] if options.end is None else options.end
    if end <= scenario.times[0]:
        raise BadInputError(f"Argument `--end` must be after the start, {scenario.times[0]:g}, but it is {end:g}.")
    spectrum = lyapunov_spectrum(
        scenario.system,
        (scenario.times[0], end),
        scenario.state,
        exponents=options.exponents,
        transient=options.transient,
        interval=options.interval or 1.0,
        solver=SOLVERS[scenario.solver](),
        rtol=scenario.rtol,
        atol=scenario.atol,
    )
    write_json(options, _content(scenario, spectrum))
    if not spectrum.ok:
        print(f"jaxball: {spectrum.message}", file=sys.stderr)
        return FAILED_SOLVE
    written = write_outputs(
        options, scenario, lambda path: _save(spectrum, path), lambda plot: plot.lyapunov_convergence(spectrum)
    )
    say(options, scenario.title, spectrum, written)
    return 0


def _content(scenario: Scenario, spectrum: LyapunovSpectrum) -> dict:
    limits = spectrum.limits
    force = spectrum.least_normal_force
    return {
        "title": scenario.title,
        "ok": spectrum.ok,
        "message": spectrum.message,
        "reached": float(spectrum.reached),
        "exponents": np.asarray(spectrum.exponents),
        "standard_error": np.asarray(spectrum.standard_error),
        "told_from_zero": limits.told,
        "limits": limits.limits,
        "dimension": spectrum.dimension,
        "least_normal_force": None if force is None else float(force),
    }


def _save(spectrum: LyapunovSpectrum, path: Path) -> None:
    """The running means of the exponents, one row for each interval."""
    times, means = np.asarray(spectrum.times), np.asarray(spectrum.running)
    header = ["time", *(f"exponent[{k}]" for k in range(means.shape[1]))]
    write_csv(path, header, np.column_stack([times, means]).tolist())
