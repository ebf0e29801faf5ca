"""``jaxball design``: rails, motions and parameters found that make a ball do what is wanted."""

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...interface.interruption import last_words
from ...interface.output import check_folder

UNMET = 1


def add(commands) -> None:
    """Adds the command to the subparsers of argparse."""
    parser = commands.add_parser(
        "design",
        description="Looks for a design, or goes on with a search that was stopped, whatever stopped it.",
    )
    parser.add_argument("problem", metavar="FILE", help="a problem file")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="where the design and report go")
    parser.add_argument("--quiet", action="store_true", help="say nothing of the progress")
    parser.set_defaults(run=_run, gradients=True)


def _run(options: argparse.Namespace) -> int:
    # Imported here, because the other commands have no use for it.
    from ...design.control.files import TABLE, read_control
    from ...design.errors import DesignError
    from ...design.files import problem_of
    from ...design.source import Source
    from ...scenario.sources import document_of, naming, text_of

    check_folder(options.out, "--out")
    file = Path(options.problem)
    text, folder = text_of(file, "problem file", DesignError), file.parent
    with naming(options.problem):
        document = document_of(text, "problem", DesignError)
        found = (read_control if TABLE in document else problem_of)(document, folder)
    source = Source(shlex.join(["jaxball", "design", str(file), "--out", str(options.out)]), file, text)
    source.check(options.out)

    def say(line: str) -> None:
        if not options.quiet:
            print(line, file=sys.stderr, flush=True)

    return (_control if TABLE in document else _search)(options, found, source, say)


def _control(options: argparse.Namespace, found: Any, source: Any, say: Callable[[str], None]) -> int:
    from ...design.cells import violation
    from ...design.control.means import means
    from ...design.control.report import SCENARIO, objectives_in_units, write_design, write_report
    from ...design.control.solve import controlled

    kept = False

    def keep(solution: Any) -> None:
        nonlocal kept
        write_design(solution, found.title, found.saves, options.out)
        kept = True

    def stopped() -> str:
        what = f"the last motion found is {options.out / SCENARIO}" if kept else "no motion was found yet"
        return f"Stopped; {what}."

    with last_words(stopped):
        done = controlled(found, say, keep)
        report = write_report(done, found.title, found.saves, options.out, source)
    if found.title:
        print(found.title)
    _say_objectives(means(done.solution), objectives_in_units(done))
    for name, by in done.seen.violations.items():
        print(f"  {name}: {violation(by, done.violation)}")
    print(f"  written: {report}, {options.out / SCENARIO}")
    for name, by in done.broken.items():
        sentence = f"The constraint `{name}` is violated by {by:.2g}, and {done.violation:g} is allowed"
        print(f"jaxball: {sentence}; begin with more intervals.", file=sys.stderr)
    return 0 if done.good else UNMET


def _search(options: argparse.Namespace, found: Any, source: Any, say: Callable[[str], None]) -> int:
    from ...design.cells import violation
    from ...design.remarks import remarks
    from ...design.report import objectives_in_units, write_report
    from ...design.search import PROGRESS, SCENARIO, design

    def stopped() -> str:
        if not all((options.out / name).exists() for name in (PROGRESS, SCENARIO)):
            return "Stopped; no design was found yet."
        return f"Stopped; the best design so far is {options.out / SCENARIO}; run the same command to resume."

    with last_words(stopped):
        done = design(found.problem, found.settings, options.out, identity=found.identity, say=say)
        report = write_report(done, found.title, options.out, source)
    if found.title:
        print(found.title)
    values = dict(zip(found.problem.objectives, done.verified.finer.terms.tolist(), strict=True))
    _say_objectives(values, objectives_in_units(done))
    for name, (_, by) in done.verified.violations.items():
        print(f"  {name}: {violation(by, found.settings.tolerance)}")
    print(f"  written: {report}, {options.out / SCENARIO}")
    for remark in remarks(done):
        print(f"jaxball: {remark}", file=sys.stderr)
    return 0 if done.feasible else UNMET


def _say_objectives(values: dict[str, float], meant: dict[str, str]) -> None:
    """The values, with the lengths, angles and times that they stand for."""
    for name, value in values.items():
        print(f"  {name}: {value:.6g}{f' ({meant[name]})' if meant[name] else ''}")
