"""The Lyapunov exponents of a scenario."""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ...chaos import LyapunovSpectrum, lyapunov_spectrum
from ...scenario import Scenario
from ...scenario.body import rolling_state
from ...scenario.solvers import SOLVERS
from ..input import scenario_of
from ..options import FAILED_SOLVE, BadInputError
from ..output import say, working
from .files import write_csv, write_json, write_outputs


def run(options: argparse.Namespace, document: dict[str, Any]) -> int:
    """Computes the exponents of a document, saves and draws their running means."""
    scenario = scenario_of(document, options.scenario)
    state = rolling_state(scenario.state, scenario.contact, "Lyapunov exponents are")
    end = scenario.times[-1] if options.end is None else options.end
    if end <= scenario.times[0]:
        raise BadInputError(f"Argument `--end` must be after the start, {scenario.times[0]:g}, but it is {end:g}.")
    with working(options, "computing Lyapunov exponents"):
        spectrum = lyapunov_spectrum(
            scenario.system,
            (scenario.times[0], end),
            state,
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
