"""Loads the folder that ``jaxball design`` wrote as a :class:`Result`, and states the provenance of its report."""

import importlib.metadata
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from jaxtyping import Float

from ...files.results.saving import PACKAGES
from ...files.scenario import read_document
from ...files.scenario.files import load_scenario
from ...files.scenario.scenario import Scenario
from ...files.scenario.sources import document_of, naming, scenario_document, text_of
from ...interface.output import OutputError, write_text
from ...interface.printing import repr_html
from ...interface.wording import duration, number_of
from .constraints import discs_to_avoid
from .files import CONTROL_TABLE, problem_of, read_control
from .objectives import target_path
from .problem.requirements import Requirement
from .problem.space import DesignError
from .search.design import PROGRESS, SCENARIO

COPY, REPORT = "problem.toml", "report.md"


class Source(NamedTuple):
    """A problem file and the command that read it.

    - ``command``: as it can be typed again.
    - ``file``: its path, and ``text``, its content when it was read.
    """

    command: str
    file: Path
    text: str

    @property
    def document(self) -> dict[str, Any]:
        """The problem, its scenario written out, so that it needs no other file."""
        document = tomllib.loads(self.text)
        return {**document, "scenario": scenario_document(document["scenario"], self.file.parent, DesignError)}

    def check(self, folder: Path) -> None:
        """Refuses a folder that has another problem's copy, or files of its user that a design would replace.

        **Raises:** :class:`~jaxball.files.results.OutputError`.
        """
        there = folder / COPY
        # The file being read may itself be the copy in its folder, when a search is resumed from there.
        if there.exists() and not self._is(there) and _document(there) != self.document:
            raise OutputError(
                f'Argument `--out` must be a folder without another problem, but "{there}" is not the one being '
                "read; choose another folder, or remove it."
            )
        # A copy, or beside the file itself the progress of its search, shows that an earlier run wrote the others.
        if self._is(there) and CONTROL_TABLE not in self.document:
            there = folder / PROGRESS
        for name in (SCENARIO, REPORT):
            if (folder / name).exists() and not there.exists() and not (folder / PROGRESS).exists():
                raise OutputError(
                    "Argument `--out` must be a folder without files that a design would replace, but "
                    f'"{folder / name}" is there; choose another folder, or remove it.'
                )

    def copy(self, folder: Path) -> None:
        """Writes the copy: the text itself, or, where the scenario is in another file, the problem with it."""
        if self._is(folder / COPY):
            return
        folder.mkdir(parents=True, exist_ok=True)
        document = tomllib.loads(self.text)
        # The user's own text with its comments, if it needs no other file.
        write_text(folder / COPY, self.text if isinstance(document["scenario"], dict) else tomli_w.dumps(self.document))

    def _is(self, path: Path) -> bool:
        return path.exists() and path.samefile(self.file)


def provenance(source: Source | None, elapsed: float, resumed: bool = False) -> list[list[str]]:
    """Returns the parts of a report that say how it was made; ``elapsed`` is in seconds."""
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    by = "By" if source is None else f"By `{source.command}`, with"
    time = f"in {duration(elapsed)}{', all runs of the search together' * resumed}"
    parts = [["## How it was made"], [f"{by} {versions}, {time}."]]
    if source is not None:
        parts.append([f"The problem is `{COPY}`, a copy of the file that was read."])
    return parts


def _document(path: Path) -> Any:
    """Reads the content of a file; None if it is not a document."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None


class Result(NamedTuple):
    """A design and its starting point.

    - ``title``: that of the problem.
    - ``before``: the scenario at the start of the search; for a problem of optimal control, its given scenario.
    - ``after``: the scenario that was found.
    - ``wanted``: points of the curve to follow, length, shape (k, 2); None if there is none.
    - ``discs``: centre and radius of each disc in the plane to avoid, length.
    """

    title: str
    before: Scenario
    after: Scenario
    wanted: Float[np.ndarray, "k 2"] | None
    discs: tuple[tuple[Float[np.ndarray, "2"], float], ...] = ()

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        before, after = (repr(scenario).partition("\n")[0] for scenario in (self.before, self.after))
        lines = [f"Result of a design: {self.title}", f"  before: {before}", f"  after: {after}"]
        lines += [] if self.wanted is None else [f"  a curve to follow, {number_of(len(self.wanted), 'point')}"]
        return "\n".join(lines + ([f"  {number_of(len(self.discs), 'disc')} to avoid"] if self.discs else []))


def load_result(folder: str | Path) -> Result:
    """Reads the design in a ``folder`` that ``jaxball design --out`` wrote; the best so far, if the search is not
    finished.

    It has ``problem.toml`` and ``design.toml``.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, where there is no such folder, and where one of the
    files cannot be read or its scenario cannot be run.
    """
    folder = Path(folder)
    missing = [name for name in (COPY, SCENARIO) if not (folder / name).is_file()]
    if missing:
        raise DesignError(
            f'Argument `folder` must be one that jaxball design wrote, but "{folder}" has no '
            f"{' and no '.join(missing)}."
        )
    after = load_scenario(folder / SCENARIO)
    with naming(folder / COPY):
        text = text_of(folder / COPY, "problem file", DesignError)
        title, before, requirements = _problem(document_of(text, "problem", DesignError), folder)
    return Result(title or after.title, before, after, target_path(requirements), discs_to_avoid(requirements))


def _problem(document: dict[str, Any], folder: Path) -> tuple[str, Scenario, list[Requirement]]:
    """Reads the title, the scenario at the start, and the objectives and constraints of a problem of either kind."""
    if CONTROL_TABLE in document:
        control = read_control(document, folder)
        scenario = read_document(scenario_document(document["scenario"], folder, DesignError))
        return control.title, scenario, _requirements(control.problem)
    title, problem, *_ = problem_of(document, folder)
    space = problem.space
    return title, space.scenario_of(space.values(space.start)), _requirements(problem)


def _requirements(problem: Any) -> list[Requirement]:
    return [*problem.objectives.values(), *problem.constraints.values()]
