"""``jaxball validate``: lists everything that is wrong with files, without running them."""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...files.scenario.errors import ScenarioError, all_problems
from ...files.scenario.logs import with_logs
from ...files.scenario.sources import builtin_scenarios, builtin_text, document_of, text_of
from ...interface.wording import heading, number_of, plain
from ..input import CONTROL, PROBLEM, SCENARIO, STUDY, first_problems, input_text, kind_of_document, source_name
from ..jax_setup import set_up_jax
from ..options import BAD_INPUT, sentence

WHAT = "scenario, study or problem"


def add(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Reads scenarios, studies and problems, recognised by their keys, and lists everything that is wrong. "
        "Nothing is simulated. The exit code is 2 if a file is not valid."
    )
    parser.add_argument("files", nargs="+", metavar="FILE", help="a file, a built-in scenario, or - for standard input")
    parser.add_argument("--quiet", action="store_true", help="print nothing about valid files")


def run(options: argparse.Namespace) -> int:
    all_valid = True
    for source in options.files:
        description = ""
        with all_problems() as problems:
            description = _describe(source)
        name = source_name(source)
        for problem in first_problems(problems):
            print(plain(f"{name}: {sentence(problem)}"), file=sys.stderr)
        if not problems and not options.quiet:
            print(plain(f"{name} is valid: {description}"), flush=True)
        all_valid &= not problems
    return 0 if all_valid else BAD_INPUT


def _describe(source: str) -> str:
    """Describes the contents of a file in one line; by default, a document is taken for a scenario.

    **Raises:** :class:`~jaxball.ScenarioError` for a file that is not valid.
    """
    document = _document(source)
    set_up_jax()
    readers = {SCENARIO: _scenario, STUDY: _study, CONTROL: _control, PROBLEM: _problem}
    kind, title = kind_of_document(document) or SCENARIO, document.get("title", "")
    content = readers[kind](document, Path(source).parent)
    return f'{kind.words}, "{heading(title)}": {content}.' if title else f"{kind.words}: {content}."


def _document(source: str) -> dict[str, Any]:
    if source in builtin_scenarios():
        return document_of(builtin_text(source), "scenario", ScenarioError)
    text = input_text(source)
    text = text_of(source, WHAT, ScenarioError) if text is None else text
    return document_of(text, WHAT, ScenarioError)


def _scenario(document: dict[str, Any], folder: Path) -> str:
    from ...files.scenario import read_document

    scenario = read_document(with_logs(document, folder))
    times, what = scenario.times, scenario.system.describe()
    return f"{what}, {len(times)} times from {times[0]:g} to {times[-1]:g} by {scenario.solver}"


def _study(document: dict[str, Any], folder: Path) -> str:
    import tomli_w

    from ...studies.sweep import read_study

    study = read_study(tomli_w.dumps(document), folder)
    shape = " × ".join(f"{size:,}" for size in study.shape)
    rows = number_of(study.rows, "row")
    return f"{rows}{f' ({shape})' if len(study.shape) > 1 else ''} of {', '.join(study.paths)}"


def _problem(document: dict[str, Any], folder: Path) -> str:
    from ...studies.design.files import problem_of

    problem = problem_of(document, folder).problem
    variables = number_of(problem.space.size, "variable")
    return f"{variables}; {_names('objectives', problem.objectives)}; {_names('constraints', problem.constraints)}"


def _control(document: dict[str, Any], folder: Path) -> str:
    from ...studies.design.files import read_control

    return f"{read_control(document, folder).intervals} intervals to start with"


def _names(what: str, items: Mapping[str, Any]) -> str:
    return f"{what} {', '.join(items)}" if items else f"no {what}"
