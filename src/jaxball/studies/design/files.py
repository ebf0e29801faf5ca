"""Reads problem files: a scenario, objectives and constraints, and the variables of a search or a table `[control]`."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx

from ...files.scenario import read_document
from ...files.scenario.body import rolling_state
from ...files.scenario.errors import ScenarioError, describe, each_of, key_error, raise_first, try_readers
from ...files.scenario.files import ABOUT, OF_SCENARIO
from ...files.scenario.sources import document_of, naming, naming_scenario, scenario_document, text_of
from ...files.scenario.table import Key, Keys, join, read_list, read_table
from ...files.scenario.values import Choice, Integer, Kind, Nested, Numbers, unread
from ...numerics.arrays import to_array
from ...numerics.declare import NOT_NEGATIVE, POSITIVE
from ...physics.body import System
from ...physics.state import BallState, DiskState
from .kinds import CONSTRAINTS, OBJECTIVES, PLANE, Plane, Requirements, plane_of
from .optimal_control.collocation import BARRIER
from .optimal_control.problem import VIOLATION
from .optimal_control.rolling import Rolling
from .optimal_control.solve import BARRIER_OF_TIME, ControlFile, FreeEndTime, Guess
from .problem.problem import Perturbations, Problem
from .problem.requirements import (
    AbstractRunningConstraint,
    AbstractRunningObjective,
)
from .problem.space import DesignError, DesignSpace, Variable
from .search.program import COUNTS, METHODS, MOST, Settings

CONTROL_TABLE = "control"
LIST = "a list of tables"
# The keys of problems of either kind.
SHARED = {
    **ABOUT,
    **OF_SCENARIO,
    "objectives": Key(
        unread(LIST, OBJECTIVES.keys(PLANE), forms=("list",)), says="what is minimised, each under [[objectives]]"
    ),
    "constraints": Key(
        unread(LIST, CONSTRAINTS.keys(PLANE), forms=("list",)), [], says="what must hold, each under [[constraints]]"
    ),
}
_PATHS = Nested(
    lambda value, path: _paths(value, path), lambda value, path: list(value), "a path, or a list of paths", forms=()
)
_VARIABLE = {
    "path": Key(_PATHS, says=(Variable, "paths")),
    "factors": Key(Numbers((None,)), (), says=(Variable, "factors")),
    **{name: Key(Numbers(), None, says=(Variable, name)) for name in ("lower", "upper", "scale", "start")},
}
_ROBUST = {
    "count": Key(Integer(1, 10**6), says=(Perturbations, "count")),
    **{name: Key(Numbers(rule=NOT_NEGATIVE), says=(Perturbations, name)) for name in ("masses", "offset")},
    "seed": Key(Integer(0, 10**6), 0, says=(Perturbations, "seed")),
}
_OF_SETTINGS: dict[str, Kind] = {
    **{name: Integer(least, MOST) for name, least in COUNTS.items()},
    "method": Choice(METHODS),
}
_SETTINGS = {
    field.name: Key(_OF_SETTINGS.get(field.name, Numbers(rule=POSITIVE)), field.default, (Settings, field.name))
    for field in dataclasses.fields(Settings)
}
SEARCH_KEYS = {
    **SHARED,
    "variables": Key(unread(LIST, {"": _VARIABLE}, forms=("list",)), says="what is sought, each under [[variables]]"),
    "robust": Key(unread(tables={"": _ROBUST}), None, (Problem, "perturbations")),
    "search": Key(unread(tables={"": _SETTINGS}), None, says="settings of the search"),
}
GUESSES: dict[str, Guess] = {"rest": Rolling.at_rest, "rolling-along": Rolling.rolling_along}
_CONTROL = {
    "depth": Key(
        Numbers(rule=POSITIVE),
        None,
        says="how far the centre of mass is below the geometric centre at the end, in radii; free if not given",
    ),
    "intervals": Key(Integer(2, 10**5), 20, (ControlFile, "intervals")),
    "tolerance": Key(Numbers(rule=POSITIVE), 1e-6, (ControlFile, "tolerance")),
    "violation": Key(Numbers(rule=POSITIVE), VIOLATION, (ControlFile, "violation")),
    "barrier": Key(
        Numbers(rule=POSITIVE),
        None,
        says=f"the initial barrier parameter µ; {BARRIER} if not given, or {BARRIER_OF_TIME} where the end time is "
        f"free",
    ),
    "softness": Key(
        Numbers(rule=NOT_NEGATIVE),
        0.0,
        says="how much conditions at the end may yield; 1e-7 where some follow from others, as for rotors",
    ),
    "guess": Key(Choice(tuple(GUESSES)), "rest", (ControlFile, "guess")),
    "first_weights": Key(unread("a table of weights"), None, (ControlFile, "easy")),
    "free_end_time": Key(Numbers((2,)), None, (ControlFile, "free_end_time")),
    "time_weight": Key(Numbers(rule=NOT_NEGATIVE), 1.0, (FreeEndTime, "weight")),
}


def _control_keys(place: Numbers) -> Keys:
    says = "where the ball comes to rest, a single number for a disk, length; free if not given"
    return {"place": Key(place, None, says), **_CONTROL}


def control_table(plane: Plane) -> Nested:
    """Returns the kind of value of the table `[control]`, of a ball or a disk."""
    return unread(tables={"": _control_keys(plane.place)})


# Where the end time is free, it may be the only objective.
OBJECTIVES_OF_CONTROL = {
    "objectives": Key(
        SHARED["objectives"].kind,
        [],
        says="what is minimised, each under [[objectives]]; required unless the end time is free",
    )
}
CONTROL_KEYS = {
    **SHARED,
    **OBJECTIVES_OF_CONTROL,
    CONTROL_TABLE: Key(control_table(PLANE), says="the end of the motion, and settings of the solution"),
}


class ProblemFile(NamedTuple):
    """The content of a problem file."""

    title: str
    problem: Problem
    settings: Settings


def load_problem(source: str | Path) -> ProblemFile:
    """Reads the problem of the file at the path ``source``.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, when there is no such file, when it is not TOML, and
    when a key of it or of its scenario is misspelt, missing or wrong.
    """
    text = text_of(source, "problem file", DesignError)
    with naming(source):
        return read_problem(text, Path(source).parent)


def read_problem(text: str, folder: str | Path = ".") -> ProblemFile:
    """Reads the problem that the ``text`` of a file describes; a scenario file is looked for relative to ``folder``.

    **Raises:** as :func:`load_problem`.
    """
    return problem_of(document_of(text, "problem", DesignError), folder)


def problem_of(document: dict[str, Any], folder: str | Path = ".") -> ProblemFile:
    """Reads the problem of a document; a scenario file is looked for relative to ``folder``.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, when a key of it or of its scenario is misspelt,
    missing or wrong.
    """
    if CONTROL_TABLE in document:
        raise DesignError(
            f"Key `{CONTROL_TABLE}` must be left out here, because it makes the file a problem of optimal control; "
            "`jaxball design` solves that, and in Python it is made with `optimal_control.Rolling`."
        )
    (table, space, search, robust), errors = try_readers(
        lambda: read_table(document, "", SEARCH_KEYS),
        lambda: _space(document, Path(folder)) if {"scenario", "variables"} <= document.keys() else None,
        lambda: read_table(document.get("search", {}), "search", _SETTINGS),
        lambda: _perturbations(document["robust"]) if "robust" in document else None,
    )
    objectives, constraints = {}, {}
    if table and space:  # which determines the kind of positions
        (objectives, constraints), later = _requirements(table, space.system)
        errors += later
    raise_first(errors)
    settings = Settings(**search)
    return ProblemFile(table["title"], Problem(space, objectives, constraints, robust), settings)


def read_control(document: dict[str, Any], folder: str | Path = ".") -> ControlFile:
    """Reads the problem of a document with a table ``[control]``; a scenario file is looked for relative to ``folder``.

    **Raises:** as :func:`problem_of`.
    """
    table = read_table(document, "", CONTROL_KEYS)
    with naming_scenario(table["scenario"], "problem", DesignError):
        scenario = read_document(scenario_document(table["scenario"], Path(folder), DesignError))
    system, state = scenario.system, scenario.state
    if not isinstance(system, System):
        raise key_error("scenario.kind", "ball or disk", system.title.lower())
    rolling_state(scenario, "optimal control is", DesignError)
    assert isinstance(state, BallState | DiskState)
    control = read_table(table[CONTROL_TABLE], CONTROL_TABLE, _control_keys(plane_of(system).place))
    free = _free_end_time(control, table[CONTROL_TABLE], (float(scenario.times[0]), float(scenario.times[-1])))
    (objectives, constraints), errors = _requirements(table, system, timed=free is not None)
    raise_first(errors)
    _require(objectives, OBJECTIVES, AbstractRunningObjective, "means over the run")
    _require(constraints, CONSTRAINTS, AbstractRunningConstraint, "constraints at each time")
    ends = {name: control[name] for name in ("place", "depth", "softness")}
    problem = Rolling(system, scenario.times[[0, -1]], objectives, state, **ends, constraints=constraints)
    easy = None if control["first_weights"] is None else _easy(problem, control["first_weights"])
    barrier = (BARRIER_OF_TIME if free else BARRIER) if control["barrier"] is None else control["barrier"]
    tolerance, violation, barrier = map(float, (control["tolerance"], control["violation"], barrier))
    how = control["intervals"], tolerance, violation, barrier, GUESSES[control["guess"]]
    return ControlFile(table["title"], problem, easy, scenario.times.size, *how, scenario.units, free)


def _free_end_time(control: dict[str, Any], given: dict[str, Any], times: tuple[float, float]) -> FreeEndTime | None:
    """Returns the end time that is to be found, if it is; the scenario's ``times`` have a guess of it."""
    name = "free_end_time"
    if control[name] is None:
        if "time_weight" in given:
            raise key_error(join(CONTROL_TABLE, "time_weight"), f"left out without `{name}`", "given")
        return None
    if control["first_weights"] is not None:
        raise key_error(join(CONTROL_TABLE, "first_weights"), f"left out with `{name}`", "given")
    shortest, longest = map(float, control[name])
    free = FreeEndTime(shortest, longest, float(control["time_weight"]))
    try:
        free.check(*times)
    except DesignError as error:
        raise DesignError(f"Key `{join(CONTROL_TABLE, name)}`{str(error).removeprefix(f'Argument `{name}`')}") from None
    return free


def _requirements(table: dict[str, Any], system: System, timed: bool = False) -> tuple[list[Any], list[ScenarioError]]:
    """Reads the objectives and the constraints of a problem of either kind, by name, and the errors in them; where
    it is ``timed``, it may have no objectives.
    """
    plane = plane_of(system)
    return try_readers(
        lambda: _read_by_kind(table["objectives"], OBJECTIVES, plane, empty=timed),
        lambda: _read_by_kind(table["constraints"], CONSTRAINTS, plane, empty=True),
    )


def _read_by_kind(values: Any, requirements: Requirements, plane: Plane, empty: bool = False) -> dict[str, Any]:
    """Reads objectives or constraints by their kinds; a second one of a kind has a number appended."""
    objects: dict[str, Any] = {}
    for kind, item in read_list(
        values, requirements.path, lambda item, path: requirements.read(item, path, plane), empty
    ):
        count = sum(name.split(" ")[0] == kind for name in objects)
        objects[f"{kind} {count + 1}" if count else kind] = item
    return objects


def _require(objects: dict[str, Any], requirements: Requirements, running: type, words: str) -> None:
    """Refuses anything that is not a function of a single time."""
    for name, item in objects.items():
        if not isinstance(item, running):
            family = requirements.family(PLANE)
            kinds = ", ".join(kind for kind, member in family.items() if issubclass(member.type, running))
            raise key_error(requirements.path, f"{words} ({kinds}) together with `{CONTROL_TABLE}`", name)


def _space(document: dict[str, Any], folder: Path) -> DesignSpace:
    scenario, variables = each_of(
        lambda: scenario_document(document["scenario"], folder, DesignError),
        lambda: read_list(document["variables"], "variables", _variable),
    )
    with naming_scenario(document["scenario"], "problem", DesignError):
        return DesignSpace(scenario, variables)


def _variable(values: Any, path: str) -> Variable:
    arguments = {name: value for name, value in read_table(values, path, _VARIABLE).items() if value is not None}
    paths, factors = arguments.pop("path"), tuple(float(x) for x in arguments.pop("factors"))
    try:
        return Variable(paths, factors=factors, **arguments)
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
        raise key_error(path, "a path, or a list of paths", describe(value))
    return tuple(paths)


def _easy(problem: Rolling, weights: Any) -> Rolling:
    """Returns the problem with other weights of some objectives."""
    path = f"{CONTROL_TABLE}.first_weights"
    if not isinstance(weights, dict) or not weights:
        raise key_error(path, "a table of weights by kind of objective", describe(weights))
    unknown = [name for name in weights if name not in problem.objectives]
    if unknown:
        raise key_error(path, f"of objectives of this problem ({', '.join(problem.objectives)})", unknown[0])
    entries = read_table(weights, path, dict.fromkeys(weights, Key(Numbers())))
    values = [to_array(entries[name]) for name in weights]
    return eqx.tree_at(lambda p: [p.objectives[name].weight for name in weights], problem, values)
