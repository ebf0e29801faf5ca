"""``jaxball design``: searches for rails, motions and parameters with which a ball does what a problem file asks."""

import argparse
import shlex
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...interface.activity import Line
from ...interface.interruption import interrupt_message
from ...interface.output import check_folder
from ...interface.wording import heading
from ..input import PROBLEMS, gather_problems, text_and_document
from ..jax_setup import set_up_jax
from ..options import working

UNMET = 1
REPORTING = "writing the report, with its figures"


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = "Searches for a design, or resumes one that was interrupted, for whatever reason."
    parser.add_argument("problem", metavar="FILE", help="a problem file")
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder for the design and report")
    parser.add_argument("--quiet", action="store_true", help="print no progress")


def run(options: argparse.Namespace) -> int:
    check_folder(options.out, "--out")
    text, document = text_and_document(options.problem, "problem", *PROBLEMS)
    file = Path(options.problem)
    with working(options, "reading the problem"):
        set_up_jax()
        from ...studies.design.files import CONTROL_TABLE, problem_of, read_control
        from ...studies.design.result import Source

        with gather_problems(options.problem):
            problem_file = (read_control if CONTROL_TABLE in document else problem_of)(document, file.parent)
    source = Source(shlex.join(["jaxball", "design", str(file), "--out", str(options.out)]), file, text)
    # Now, because a search of hours must not end in a refusal.
    source.check(options.out)
    return (_control if CONTROL_TABLE in document else _search)(options, problem_file, source)


def _progress(options: argparse.Namespace, line: Line) -> Callable[[str], None]:
    """Returns the function that takes lines of progress."""
    return lambda text: None if options.quiet else line.print(text, sys.stderr)


def _control(options: argparse.Namespace, problem_file: Any, source: Any) -> int:
    from ...studies.design.optimal_control.solve import solve_control
    from ...studies.design.report import objectives_in_units, violation, write_control_report, write_design
    from ...studies.design.search.design import SCENARIO

    saved = False

    def save(solution: Any) -> None:
        nonlocal saved
        source.copy(options.out)  # by which a folder is known to be that of a design
        write_design(solution, problem_file.title, problem_file.saves, options.out, problem_file.units)
        saved = True

    def describe_stop() -> str:
        what = f"the last motion found is {options.out / SCENARIO}" if saved else "no motion was found yet"
        return f"Stopped; {what}."

    with interrupt_message(describe_stop), working(options, "searching for a motion") as line:
        say = _progress(options, line)
        done = solve_control(problem_file, say, save)
        say(REPORTING)
        report = write_control_report(done, problem_file.title, problem_file.saves, options.out, source)
    violations = {name: violation(by, done.violation) for name, by in done.seen.violations.items()}
    end_time = {} if done.free_end_time is None else {"end time": float(done.solution.path.mesh[-1])}
    _print_summary(problem_file.title, end_time | done.solution.means(), objectives_in_units(done), violations)
    print(f"  written: {report}, {options.out / SCENARIO}")
    for name, by in done.broken.items():
        sentence = f"The constraint `{name}` is violated by {by:.2g}, where {done.violation:g} is allowed"
        print(f"jaxball: {sentence}; start with more intervals.", file=sys.stderr)
    return 0 if done.ok else UNMET


def _search(options: argparse.Namespace, problem_file: Any, source: Any) -> int:
    from ...studies.design.report import objectives_in_units, violation, write_report
    from ...studies.design.search.design import PROGRESS, SCENARIO, warnings

    def describe_stop() -> str:
        # A search writes both; before that there is nothing to resume.
        if not all((options.out / name).exists() for name in (PROGRESS, SCENARIO)):
            return "Stopped; no design was found yet."
        return f"Stopped; the best design so far is {options.out / SCENARIO}; run the same command to resume."

    problem, settings = problem_file.problem, problem_file.settings
    with interrupt_message(describe_stop), working(options, "searching for a design") as line:
        say = _progress(options, line)
        done = problem.optimise(settings, options.out, say=say)
        say(REPORTING)
        report = write_report(done, problem_file.title, options.out, source)
    values = dict(zip(problem.objectives, done.verified.finer.terms.tolist(), strict=True))
    violations = {name: violation(by, settings.tolerance) for name, (_, by) in done.verified.violations.items()}
    _print_summary(problem_file.title, values, objectives_in_units(done), violations)
    print(f"  written: {report}, {options.out / SCENARIO}")
    for warning in warnings(done):
        print(f"jaxball: {warning}", file=sys.stderr)
    return 0 if done.feasible else UNMET


def _print_summary(title: str, objectives: dict[str, float], in_units: dict[str, str], violations: dict[str, str]):
    """Prints the objectives, with the lengths, angles and times that they stand for, and the constraints."""
    if title:
        print(heading(title))
    for name, value in objectives.items():
        print(f"  {name}: {value:.6g}{f' ({in_units[name]})' if in_units.get(name) else ''}")
    for name, sentence in violations.items():
        print(f"  {name}: {sentence}")
