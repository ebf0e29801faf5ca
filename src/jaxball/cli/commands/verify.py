"""``jaxball verify``: the laws of mechanics, checked on runs of scenarios."""

import argparse
from collections.abc import Mapping
from typing import Any

from ...scenario import builtin_scenarios
from ...verify import LAWS, Report, verify
from ..input import named_scenario
from ..options import FAILED_SOLVE, BadInputError
from ..output import STDOUT, add_json, check_json, say, write_json

LAW_BROKEN = 1


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "verify",
        description="Runs scenarios and checks every law that applies. The exit code is 1 if a run cannot be believed.",
        epilog="Laws: " + "; ".join(f"{name}: {what}" for name, what in LAWS.items()) + ".",
    )
    parser.add_argument(
        "scenarios",
        nargs="*",
        metavar="FILE|NAME",
        help="scenario files, built-in scenarios (default: all of those), or -",
    )
    parser.add_argument("--laws", nargs="+", metavar="LAW", help="only these (default: all)")
    parser.add_argument("--quick", action="store_true", help="leave out checks for which another solver is compiled")
    add_json(parser, "the reports")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    check_json(options)
    names = options.scenarios or builtin_scenarios()
    # All are read before the first run, so that a misspelt name is not discovered after minutes.
    scenarios = {name: named_scenario(name) for name in names}
    reports = {}
    for name, scenario in scenarios.items():
        try:
            reports[name] = verify(scenario, laws=options.laws, quick=options.quick)
        except ValueError as error:
            raise BadInputError(str(error)) from None
        say(options, f"{name}: {reports[name]}")
        if options.json != STDOUT:
            write_json(options, _content(reports))
    if options.json == STDOUT:
        write_json(options, _content(reports))
    if any(report.failure for report in reports.values()):
        return FAILED_SOLVE
    return 0 if all(report.ok for report in reports.values()) else LAW_BROKEN


def _content(reports: Mapping[str, Report]) -> dict[str, Any]:
    return {name: report.as_dict() for name, report in reports.items()}
