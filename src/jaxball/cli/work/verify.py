"""Simulates scenarios, and checks their runs."""

import argparse
from collections.abc import Mapping
from typing import Any

from ...results import load_run
from ...scenario import Scenario
from ...verify import Report, verify
from ..input import is_run, scenario_of
from ..jax_setup import compiled_for
from ..options import FAILED_SOLVE, BadInputError
from ..output import STDOUT, say, working, written_line
from .files import write_json

LAW_BROKEN = 1


def run(options: argparse.Namespace, documents: Mapping[str, dict[str, Any]]) -> int:
    """Prints a report for each of ``documents``, which have the names of their sources."""
    scenarios = {name: scenario_of(document, name) for name, document in documents.items()}
    reports = {}
    for name, scenario in scenarios.items():
        try:
            with working(options, f"checking {name}"), compiled_for(scenario):
                run = load_run(name) if is_run(name) else None
                known = scenario if run is None or run.scenario is None else run
                reports[name] = verify(known, laws=options.laws, quick=options.quick)
        except ValueError as error:
            raise BadInputError(str(error)) from None
        say(options, f"{name}: {reports[name]}", _drawn(options, scenario, reports[name]))
        if options.json != STDOUT:
            write_json(options, _content(reports))
    if options.json == STDOUT:
        write_json(options, _content(reports))
    if any(report.failure for report in reports.values()):
        return FAILED_SOLVE
    return 0 if all(report.ok for report in reports.values()) else LAW_BROKEN


def _drawn(options: argparse.Namespace, scenario: Scenario, report: Report) -> str:
    """Draws the residuals where --plot asks for them, and returns the line that names the file."""
    if options.plot is None or report.failure:
        return ""
    if report.times is None or not report.residuals:
        return f"  not written: {options.plot}, because none of the laws is a balance that applies"
    # Imported here, because importing matplotlib takes longer than many commands.
    from ...plot import law_residuals
    from ...plot.report import write_figure

    with working(options, "drawing"):
        drawn = law_residuals(report.times, report.residuals)
        write_figure(drawn, options.plot, scenario.system, scenario.title)
    return written_line([options.plot])


def _content(reports: Mapping[str, Report]) -> dict[str, Any]:
    return {name: report.as_dict() for name, report in reports.items()}
