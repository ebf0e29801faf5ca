"""Problem files: a scenario, its variables, objectives, constraints, and search settings."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from ..scenario.errors import each_of, raise_first, tried
from ..scenario.sources import SCENARIO, document_of, naming, naming_scenario, scenario_document, text_of
from ..scenario.table import Family, Key, keys_of, read_family, read_list, read_table
from ..scenario.values import (
    NOT_NEGATIVE,
    POSITIVE,
    Choice,
    Integer,
    Kind,
    Nested,
    Numbers,
    Text,
    key_error,
    shown,
    unread,
)
from .families import PLANE, constraints_of, objectives_of, plane_of
from .problem.problem import Perturbations, Problem
from .problem.space import DesignSpace
from .problem.variables import DesignError, Variable
from .search.program import METHODS, Settings

FORMAT = 1
LIST = "a list of tables"
# The keys of problems of either kind.
SHARED = {
    "format": Key(Integer(FORMAT, FORMAT)),
    "title": Key(Text(), ""),
    "scenario": Key(unread(SCENARIO)),
    "objectives": Key(unread(LIST, keys_of(objectives_of(PLANE)))),
    "constraints": Key(unread(LIST, keys_of(constraints_of(PLANE))), []),
}
_NUMBER = Key(Numbers(), None)
_PATHS = Nested(lambda value, path: _paths(value, path), lambda value, path: list(value), "a path, or a list of paths")
_VARIABLE = {
    "path": Key(_PATHS),
    "factors": Key(Numbers((None,)), ()),
    "lower": _NUMBER,
    "upper": _NUMBER,
    "scale": _NUMBER,
    "start": _NUMBER,
}
_SHARE = Key(Numbers(rule=NOT_NEGATIVE))
_ROBUST = {
    "count": Key(Integer(1, 10**6)),
    "masses": _SHARE,
    "offset": _SHARE,
    "seed": Key(Integer(0, 10**6), 0),
}
_COUNTS, _FROM_ZERO = ("starts", "polished", "rounds", "evaluations", "intervals"), ("steps", "seed")
_OF_SETTINGS: dict[str, Kind] = {
    **dict.fromkeys(_COUNTS, Integer(1, 10**6)),
    **dict.fromkeys(_FROM_ZERO, Integer(0, 10**6)),
    "method": Choice(METHODS),
}
_SETTINGS = {
    field.name: Key(_OF_SETTINGS.get(field.name, Numbers(rule=POSITIVE)), field.default)
    for field in dataclasses.fields(Settings)
}
KEYS = {
    **SHARED,
    "variables": Key(unread(LIST, {"": _VARIABLE})),
    "robust": Key(unread(tables={"": _ROBUST}), None),
    "search": Key(unread(tables={"": _SETTINGS}), None),
}


class ProblemFile(NamedTuple):
    """The content of a problem file.

    - ``identity``: everything that the result depends on, as text.
    """

    title: str
    problem: Problem
    settings: Settings
    identity: str


def load_problem(source: str | Path) -> ProblemFile:
    """The problem of a file.

    **Arguments:**

    - ``source``: the path of a problem file.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, when there is no such file, when it is not TOML, and
    when a key of it or of its scenario is misspelt, missing or wrong.
    """
    text = text_of(source, "problem file", DesignError)
    with naming(source):
        return read_problem(text, Path(source).parent)


def read_problem(text: str, folder: str | Path = ".") -> ProblemFile:
    """The problem that the text of a file describes; a scenario file is looked for relative to ``folder``.

    **Arguments:**

    - ``text``: the content of a problem file.

    **Raises:** as :func:`load_problem`.
    """
    return problem_of(document_of(text, "problem", DesignError), folder)


def problem_of(document: dict[str, Any], folder: str | Path = ".") -> ProblemFile:
    """The problem of a document; a scenario file is looked for relative to ``folder``.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, when a key of it or of its scenario is misspelt,
    missing or wrong.
    """
    (given, space, search, robust), errors = tried(
        lambda: read_table(document, "", KEYS),
        lambda: _space(document, Path(folder)) if {"scenario", "variables"} <= document.keys() else None,
        lambda: read_table(document.get("search", {}), "search", _SETTINGS),
        lambda: _perturbations(document["robust"]) if "robust" in document else None,
    )
    objectives, constraints = {}, {}
    if given and space:  # which determines the kind of positions
        plane = plane_of(space.scenario.system)
        (objectives, constraints), later = tried(
            lambda: objects_of(given["objectives"], "objectives", objectives_of(plane)),
            lambda: objects_of(given["constraints"], "constraints", constraints_of(plane), empty=True),
        )
        errors += later
    raise_first(errors)
    settings = Settings(**search)
    identity = tomli_w.dumps({**document, "scenario": space.document}) + repr(settings)
    return ProblemFile(given["title"], Problem(space, objectives, constraints, robust), settings, identity)


def _space(document: dict[str, Any], folder: Path) -> DesignSpace:
    scenario, variables = each_of(
        lambda: scenario_document(document["scenario"], folder, DesignError),
        lambda: read_list(document["variables"], "variables", _variable),
    )
    with naming_scenario(document["scenario"], "problem", DesignError):
        return DesignSpace(scenario, variables)


def objects_of(values: Any, path: str, family: Family, empty: bool = False) -> dict[str, Any]:
    """Objects of a family by their kinds; a second one of a kind has a number appended."""
    objects: dict[str, Any] = {}
    read = read_list(values, path, lambda item, place: (read_family(item, place, family), item["kind"]), empty)
    for item, kind in read:
        count = sum(name.split(" ")[0] == kind for name in objects)
        objects[f"{kind} {count + 1}" if count else kind] = item
    return objects


def _variable(values: Any, path: str) -> Variable:
    given = {name: value for name, value in read_table(values, path, _VARIABLE).items() if value is not None}
    paths, factors = given.pop("path"), tuple(float(x) for x in given.pop("factors"))
    try:
        return Variable(paths, factors=factors, **given)
    except DesignError as error:
        raise DesignError(f"Key `{path}`: {error}") from None


def _perturbations(values: Any) -> Perturbations:
    try:
        return Perturbations(**read_table(values, "robust", _ROBUST))
    except DesignError as error:
        raise DesignError(f"Key `robust`: {error}") from None


def _paths(value: Any, path: str) -> tuple[str, ...]:
    paths = [value] if isinstance(value, str) else value
    if not isinstance(paths, list) or not paths or not all(isinstance(item, str) for item in paths):
        raise key_error(path, "a path, or a list of paths", shown(value))
    return tuple(paths)
