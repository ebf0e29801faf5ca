"""Reads and describes files."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ...interface.wording import counted
from ...scenario import Scenario, read_document


def described(document: dict[str, Any], folder: Path) -> str:
    """The contents of a file, in one line; files that it names are looked for relative to ``folder``.

    **Raises:** :class:`~jaxball.ScenarioError` for a document that is not valid.
    """
    return _reader(document)(document, folder)


def _reader(document: dict[str, Any]) -> Callable[[dict[str, Any], Path], str]:
    """The function that reads a document, chosen by its keys; by default, a document is taken for a scenario."""
    if "axes" in document:
        return _study
    if "control" in document:
        return _control
    return _problem if document.keys() & {"objectives", "variables"} else _scenario


def _scenario(document: dict[str, Any], folder: Path) -> str:
    return _titled("a scenario", _of_scenario(read_document(document)), document)


def _of_scenario(scenario: Scenario) -> str:
    system, times = scenario.system, scenario.times
    return f"{system.described()}, {len(times)} times from {times[0]:g} to {times[-1]:g} by {scenario.solver}"


def _study(document: dict[str, Any], folder: Path) -> str:
    # Imported here, as below, because the other commands do not need it.
    import tomli_w

    from ...sweep import read_study

    study = read_study(tomli_w.dumps(document), folder)
    shape = " × ".join(f"{size:,}" for size in study.shape)
    rows = counted(study.rows, "row")
    return _titled(
        "a study", f"{rows}{f' ({shape})' if len(study.shape) > 1 else ''} of {', '.join(study.paths)}", document
    )


def _problem(document: dict[str, Any], folder: Path) -> str:
    from ...design.files import problem_of

    problem = problem_of(document, folder).problem
    size = problem.space.size
    variables = counted(size, "variable")
    content = (variables, _names("objectives", problem.objectives), _names("constraints", problem.constraints))
    return _titled("a design problem", "; ".join(content), document)


def _control(document: dict[str, Any], folder: Path) -> str:
    from ...design.files import read_control

    problem = read_control(document, folder)
    return _titled("a problem of optimal control", f"{problem.intervals} intervals to start with", document)


def _names(what: str, items: Mapping[str, Any]) -> str:
    return f"{what} {', '.join(items)}" if items else f"no {what}"


def _titled(kind: str, content: str, document: dict[str, Any]) -> str:
    title = document.get("title", "")
    return f'{kind}, "{title}": {content}.' if title else f"{kind}: {content}."
