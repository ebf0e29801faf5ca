"""Problem files: a scenario, its variables, objectives, constraints, and how hard to look."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from ..scenario import ScenarioError
from ..scenario.gathering import each_of
from ..scenario.table import Key, read_family, read_table
from ..scenario.values import NOT_NEGATIVE, POSITIVE, Choice, Integer, Nested, Numbers, Text, key_error, shown
from ..scenario.within import SCENARIO, document_of, scenario_document, text_of
from .errors import DesignError
from .kinds import CONSTRAINTS, OBJECTIVES
from .perturbations import Perturbations
from .problem import Problem
from .settings import METHODS, Settings
from .space import DesignSpace
from .variables import Variable

FORMAT = 1
ANY = Nested(lambda value, path: value, lambda value, path: value, "a table")
LIST = Nested(lambda value, path: value, lambda value, path: value, "a list of tables")
_KEYS = {
    "format": Key(Integer(FORMAT, FORMAT)),
    "title": Key(Text(), ""),
    "scenario": Key(SCENARIO),
    "variables": Key(LIST),
    "objectives": Key(LIST),
    "constraints": Key(LIST, ()),
    "robust": Key(ANY, None),
    "search": Key(ANY, None),
}
_NUMBER, _POSITIVE = Key(Numbers(), None), Key(Numbers(rule=POSITIVE), None)
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
_SETTINGS = {
    **{field.name: _POSITIVE for field in dataclasses.fields(Settings)},
    **dict.fromkeys(_COUNTS, Key(Integer(1, 10**6), None)),
    **dict.fromkeys(_FROM_ZERO, Key(Integer(0, 10**6), None)),
    "method": Key(Choice(METHODS), None),
}


class ProblemFile(NamedTuple):
    """The content of a problem file.

    - ``identity``: all that the result depends on, as a text.
    """

    title: str
    problem: Problem
    settings: Settings
    identity: str


def load_problem(source: str | Path) -> ProblemFile:
    """The problem of a file.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, when there is no such file, when it is not TOML, and
    when a key of it or of its scenario is misspelt, missing or wrong.
    """
    return problem_of(load_document(source), Path(source).parent)


def read_problem(text: str, folder: str | Path = ".") -> ProblemFile:
    """The problem that the text of a file describes; a scenario file is looked for from ``folder`` on.

    **Raises:** as :func:`load_problem`.
    """
    return problem_of(document_of(text, "problem", DesignError), folder)


def load_document(source: str | Path) -> dict[str, Any]:
    """The document of a problem file.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, when there is no such file, or when it is not TOML.
    """
    return document_of(text_of(source, "problem", DesignError), "problem", DesignError)


def problem_of(document: dict[str, Any], folder: str | Path = ".") -> ProblemFile:
    """The problem of a document; a scenario file is looked for from ``folder`` on.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, when a key of it or of its scenario is misspelt,
    missing or wrong.
    """
    found = read_table(document, "", _KEYS)
    scenario = scenario_document(found["scenario"], Path(folder), DesignError)
    variables = [_variable(item, path) for path, item in _items(found["variables"], "variables")]
    try:
        space = DesignSpace(scenario, variables)
    except DesignError:
        raise
    except ScenarioError as error:
        raise DesignError(f"The scenario of the problem is wrong: {error}") from None
    objectives, constraints, given, robust = each_of(
        lambda: objects_of(found["objectives"], "objectives", OBJECTIVES),
        lambda: objects_of(list(found["constraints"]), "constraints", CONSTRAINTS),
        lambda: read_table({} if found["search"] is None else found["search"], "search", _SETTINGS),
        lambda: None if found["robust"] is None else _perturbations(found["robust"]),
    )
    settings = Settings(**{name: value for name, value in given.items() if value is not None})
    identity = tomli_w.dumps({**document, "scenario": space.document}) + repr(settings)
    return ProblemFile(found["title"], Problem(space, objectives, constraints, robust), settings, identity)


def objects_of(values: Any, path: str, family: Any) -> dict[str, Any]:
    """Objects of a family by their kinds; a second one of a kind has its number behind it."""
    found: dict[str, Any] = {}
    for place, item in _items(values, path, empty=family is CONSTRAINTS):
        one, kind = read_family(item, place, family), item["kind"]
        count = sum(name.split(" ")[0] == kind for name in found)
        found[f"{kind} {count + 1}" if count else kind] = one
    return found


def _items(values: Any, path: str, empty: bool = False) -> list[tuple[str, Any]]:
    if not isinstance(values, list) or not (values or empty):
        raise key_error(path, f"a list of tables, each under the heading [[{path}]]", shown(values))
    return [(f"{path}[{k}]", item) for k, item in enumerate(values)]


def _variable(values: Any, path: str) -> Variable:
    found = read_table(values, path, _VARIABLE)
    given = {name: found[name] for name in ("lower", "upper", "scale", "start") if found[name] is not None}
    factors = tuple(float(x) for x in found["factors"])
    try:
        return Variable(found["path"], factors=factors, **given)
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
