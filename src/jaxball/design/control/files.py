"""Problem files of optimal control: a scenario whose masses may move in any way, and the goals of their motion."""

from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from ...numerics.arrays import to_array
from ...physics.body import Ball, Disk
from ...physics.state import BallState, DiskState
from ...scenario import read_document
from ...scenario.contact import rolling_state
from ...scenario.sources import naming_scenario, scenario_document
from ...scenario.table import Family, Key, Keys, read_table
from ...scenario.values import NOT_NEGATIVE, POSITIVE, Choice, Integer, Numbers, key_error, shown, unread
from ..families import PLANE, Plane, constraints_of, objectives_of, plane_of
from ..files import SHARED, objects_of
from ..problem.requirements import AbstractRunningConstraint, AbstractRunningObjective
from ..problem.variables import DesignError
from .collocation import BARRIER
from .guess import rolling_along
from .homotopy import Guess, at_rest
from .problem import VIOLATION
from .rolling import Rolling

TABLE = "control"
GUESSES: dict[str, Guess] = {"rest": at_rest, "rolling-along": rolling_along}
_CONTROL = {
    "depth": Key(Numbers(rule=POSITIVE), None),
    "intervals": Key(Integer(2, 10**5), 20),
    "tolerance": Key(Numbers(rule=POSITIVE), 1e-6),
    "violation": Key(Numbers(rule=POSITIVE), VIOLATION),
    "barrier": Key(Numbers(rule=POSITIVE), BARRIER),
    "softness": Key(Numbers(rule=NOT_NEGATIVE), 0.0),
    "guess": Key(Choice(tuple(GUESSES)), "rest"),
    "first_weights": Key(unread("a table of weights"), None),
}


def _control(plane: Plane) -> Keys:
    return {"place": Key(plane.place, None), **_CONTROL}


KEYS = {**SHARED, TABLE: Key(unread(tables={"": _control(PLANE)}))}


class ControlFile(NamedTuple):
    """The content of a problem file with a table ``[control]``.

    - ``problem``: the problem to be solved; ``easy``: the same with other weights, from which continuation starts, or
      None.
    - ``saves``: the number of save times of the scenario found.
    - ``intervals``, ``tolerance``: of the first mesh, and of :func:`mesh_errors`.
    - ``violation``: how much a constraint may be violated; ``barrier``: with which the search begins.
    """

    title: str
    problem: Rolling
    easy: Rolling | None
    saves: int
    intervals: int
    tolerance: float
    violation: float
    barrier: float
    guess: Guess


def read_control(document: dict[str, Any], folder: str | Path = ".") -> ControlFile:
    """The problem of a document with a table ``[control]``; a scenario file is looked for relative to ``folder``.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence, when a key of it or of its scenario is misspelt,
    missing or wrong.
    """
    given = read_table(document, "", KEYS)
    with naming_scenario(given["scenario"], "problem", DesignError):
        scenario = read_document(scenario_document(given["scenario"], Path(folder), DesignError))
    system = scenario.system
    if not isinstance(system, Ball | Disk):
        raise key_error("scenario.kind", "ball or disk", system.title.lower())
    rolling_state(scenario.state, scenario.contact, "optimal control is", DesignError)
    plane = plane_of(system)
    control = read_table(given[TABLE], TABLE, _control(plane))
    family = objectives_of(plane)
    objectives = objects_of(given["objectives"], "objectives", family)
    _require(objectives, "objectives", AbstractRunningObjective, "means over the run", family)
    family = constraints_of(plane)
    constraints = objects_of(given["constraints"], "constraints", family, empty=True)
    _require(constraints, "constraints", AbstractRunningConstraint, "constraints at each time", family)
    times = (scenario.times[0], scenario.times[-1])
    state = scenario.state
    assert isinstance(state, BallState | DiskState)
    ends = {name: control[name] for name in ("place", "depth", "softness")}
    problem = Rolling(system, times, objectives, state, **ends, constraints=constraints)
    return ControlFile(
        title=given["title"],
        problem=problem,
        easy=None if control["first_weights"] is None else _easy(problem, control["first_weights"]),
        saves=int(np.size(scenario.times)),
        intervals=control["intervals"],
        tolerance=float(control["tolerance"]),
        violation=float(control["violation"]),
        barrier=float(control["barrier"]),
        guess=GUESSES[control["guess"]],
    )


def _require(requirements: dict[str, Any], path: str, running: type, words: str, family: Family) -> None:
    """Refuses anything that is not a function of a single time."""
    for name, requirement in requirements.items():
        if not isinstance(requirement, running):
            kinds = ", ".join(kind for kind, item in family.items() if issubclass(item.type, running))
            raise key_error(path, f"{words} ({kinds}) together with `{TABLE}`", name)


def _easy(problem: Rolling, weights: Any) -> Rolling:
    """The problem with other weights of some objectives."""
    path = f"{TABLE}.first_weights"
    if not isinstance(weights, dict) or not weights:
        raise key_error(path, "a table of weights by kind of objective", shown(weights))
    unknown = [name for name in weights if name not in problem.objectives]
    if unknown:
        raise key_error(path, f"of objectives of this problem ({', '.join(problem.objectives)})", unknown[0])
    given = read_table(weights, path, dict.fromkeys(weights, Key(Numbers())))
    values = [to_array(given[name]) for name in weights]
    return eqx.tree_at(lambda p: [p.objectives[name].weight for name in weights], problem, values)
