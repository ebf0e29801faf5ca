"""``jaxball verify``: the laws of mechanics, checked on runs of scenarios."""

import argparse
import json
from pathlib import Path

from ..output import check_destination, replacing
from ..scenario import builtin_scenarios, load_scenario
from ..verify import LAWS, verify
from .options import FAILED_SOLVE, BadInputError

LAW_BROKEN = 1


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "verify",
        description="Runs scenarios and checks every law that applies. Exit code 1 where a run is not to be believed.",
        epilog="Laws: " + "; ".join(f"{name}: {what}" for name, what in LAWS.items()) + ".",
    )
    parser.add_argument(
        "scenarios", nargs="*", metavar="FILE|NAME", help="scenario files or built-in scenarios (default: all of those)"
    )
    parser.add_argument("--laws", nargs="+", metavar="LAW", help="only these (default: all)")
    parser.add_argument("--quick", action="store_true", help="leave out what needs another solver to be compiled")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the reports into this file: .json")
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    if options.json is not None:
        check_destination(options.json, (".json",), "--json")
    names = options.scenarios or builtin_scenarios()
    # All of them before the first run, so that a misspelt name is not found out after minutes.
    scenarios = {name: load_scenario(name) for name in names}
    reports = {}
    for name, scenario in scenarios.items():
        try:
            reports[name] = verify(scenario, laws=options.laws, quick=options.quick)
        except ValueError as error:
            raise BadInputError(str(error)) from None
        print(f"{name}: {reports[name]}", flush=True)
        if options.json is not None:
            with replacing(options.json) as beside:
                content = {key: report.as_dict() for key, report in reports.items()}
                beside.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    if any(report.failure for report in reports.values()):
        return FAILED_SOLVE
    return 0 if all(report.ok for report in reports.values()) else LAW_BROKEN
