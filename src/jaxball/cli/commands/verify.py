"""``jaxball verify``: the laws of mechanics, checked on runs of scenarios."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...analysis.verify.laws import LAWS
from ...files.scenario.sources import builtin_scenarios
from ...interface.output import check_destination
from ..input import add_changes, change_document, is_run, scenario_of
from ..jax_setup import compile_for, set_up_jax
from ..options import (
    FAILED_SOLVE,
    FIGURE_SUFFIXES,
    STDOUT,
    BadInputError,
    add_json,
    check_json,
    name_files,
    say,
    working,
)

if TYPE_CHECKING:
    from ...analysis.verify.report import Report
    from ...files.scenario.scenario import Scenario

LAW_BROKEN = 1


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Runs scenarios and checks every law that applies. A saved run is compared with a new run of the "
        "scenario in its file. The exit code is 1 if a run fails verification."
    )
    parser.epilog = "Laws: " + "; ".join(f"{name}: {what}" for name, what in LAWS.items()) + "."
    parser.add_argument(
        "scenarios",
        nargs="*",
        metavar="FILE|NAME",
        help="scenario files, built-in scenarios (default: all of those), saved runs (.nc or .npz), or -",
    )
    add_changes(parser, "each of the scenarios")
    parser.add_argument("--laws", nargs="+", metavar="LAW", help="only these (default: all)")
    parser.add_argument("--quick", action="store_true", help="skip checks that need another solver to be compiled")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="draw the residuals of a run over time: .png, .pdf or .svg"
    )
    add_json(parser, "the reports")


def run(options: argparse.Namespace) -> int:
    check_json(options)
    if options.plot is not None:
        check_destination(options.plot, FIGURE_SUFFIXES, "--plot")
        if len(options.scenarios) != 1:
            raise BadInputError(
                "Argument `--plot` draws the residuals of one run; give one scenario or saved run with it."
            )
    runs = [name for name in options.scenarios if is_run(name)]
    if options.set and runs:
        raise BadInputError(
            f'Argument `--set` must be left out for a saved run, such as "{runs[0]}", which is compared with a new run '
            "of its own scenario."
        )
    # All are read before the first run, so that a misspelt name is not discovered after minutes.
    names = options.scenarios or builtin_scenarios()
    documents = {name: change_document(name, options.set) for name in names}
    set_up_jax()
    return _verify(options, documents)


def _verify(options: argparse.Namespace, documents: Mapping[str, dict[str, Any]]) -> int:
    """Prints a report for each of ``documents``, which have the names of their sources."""
    from ...analysis.verify import check_laws
    from ...files.results.loading import load_run
    from ..files import write_json

    scenarios = {name: scenario_of(document, name) for name, document in documents.items()}
    reports = {}
    for name, scenario in scenarios.items():
        try:
            with working(options, f"checking {name}"), compile_for(scenario):
                run = load_run(name) if is_run(name) else None
                subject = scenario if run is None or run.scenario is None else run
                reports[name] = check_laws(subject, laws=options.laws, quick=options.quick)
        except ValueError as error:
            raise BadInputError(str(error)) from None
        say(options, f"{name}: {reports[name]}", _draw(options, scenario, reports[name]))
        # After each report, so that a command that is stopped leaves those that are done; standard output takes one
        # document.
        if options.json != STDOUT:
            write_json(options, _content(reports))
    if options.json == STDOUT:
        write_json(options, _content(reports))
    if any(report.failure for report in reports.values()):
        return FAILED_SOLVE
    return 0 if all(report.ok for report in reports.values()) else LAW_BROKEN


def _draw(options: argparse.Namespace, scenario: "Scenario", report: "Report") -> str:
    """Draws the residuals where --plot asks for them, and returns the line that names the file."""
    if options.plot is None or report.failure:
        return ""
    if report.times is None or not report.residuals:
        return f"  not written: {options.plot}, because none of the laws is a balance that applies"
    from ...plot import law_residuals
    from ...plot.report import write_figure
    from ..files import find_places

    find_places(options)
    with working(options, "drawing"):
        drawn = law_residuals(report.times, report.residuals)
        write_figure(drawn, options.plot, scenario.system, scenario.title, scenario.units)
    return name_files([options.plot])


def _content(reports: Mapping[str, "Report"]) -> dict[str, Any]:
    return {name: report.as_dict() for name, report in reports.items()}
