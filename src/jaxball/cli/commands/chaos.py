"""``jaxball chaos``: the Lyapunov exponents of a scenario, charts of the largest one, and Poincaré maps."""

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

from ...chaos import LyapunovSpectrum, lyapunov_spectrum
from ...interface.output import check_destination, replacing
from ...scenario import Scenario
from ...scenario.solve import SOLVERS
from .. import chart, poincare
from ..options import FAILED_SOLVE, BadInputError, number, positive
from ..pictures import check_figure, write_figure
from ..source import add_source, scenario_of
from ..speaking import add_speaking, check_json, say, write_json


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser("chaos")
    add_source(parser)
    parser.add_argument("--end", type=number, help="the time at which to end, instead of the scenario's")
    parser.add_argument("--transient", type=number, default=0.0, help="the time before averages begin (default: 0)")
    parser.add_argument(
        "--interval", type=positive, help="between orthonormalisations (default: 1, and 10 for a chart)"
    )
    parser.add_argument("--exponents", type=int, metavar="K", help="how many, from the largest on (default: all)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="save the numbers: .csv, and .nc of a chart")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw them: .png, .pdf or .svg")
    add_speaking(parser)
    kinds = parser.add_mutually_exclusive_group()
    chart.add_options(parser, kinds)
    poincare.add_options(parser, kinds)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_json(options)
    check_figure(options)
    poincare.check_options(options)
    try:
        if options.chart is not None:
            return chart.run(options)
        if options.poincare is not None:
            return poincare.run(options)
        return _exponents(options, scenario_of(options))
    except ValueError as error:
        raise BadInputError(str(error)) from None


def _exponents(options: argparse.Namespace, scenario: Scenario) -> int:
    if options.out is not None:
        check_destination(options.out, (".csv",), "--out")
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
    lines = [scenario.title] if scenario.title else []
    lines.append(str(spectrum))
    if options.out is not None:
        _write_means(spectrum, options.out)
        lines.append(f"  written: {options.out}")
    if options.plot is not None:
        # Imported here, because matplotlib takes longer to import than the exponents take.
        from ... import plot

        write_figure(plot.lyapunov_convergence(spectrum), options.plot, scenario)
        lines.append(f"  written: {options.plot}")
    say(options, "\n".join(lines))
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


def _write_means(spectrum: LyapunovSpectrum, path: Path) -> None:
    """The running means of the exponents, a row for each interval."""
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time", *(f"exponent[{k}]" for k in range(spectrum.running.shape[1]))])
        times, means = np.asarray(spectrum.times).tolist(), np.asarray(spectrum.running).tolist()
        writer.writerows([time, *row] for time, row in zip(times, means, strict=True))
