"""Loads the results of ``jaxball design`` from a folder: the scenarios before and after, and the desired path."""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..scenario import Scenario, load_scenario, read_document
from ..scenario.sources import naming, scenario_document
from .constraints import discs_to_avoid
from .files import problem_of
from .objectives import wanted_path
from .problem.requirements import Requirement
from .problem.variables import DesignError
from .search.design import SCENARIO
from .source import COPY


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


def load_result(folder: str | Path) -> Result:
    """The design in a folder that ``jaxball design --out`` wrote; the best so far, if the search is not finished.

    **Arguments:**

    - ``folder``: the folder, with its ``problem.toml`` and ``design.toml``.

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
        title, before, requirements = _problem(_document(folder / COPY), folder)
    return Result(title or after.title, before, after, wanted_path(requirements), discs_to_avoid(requirements))


def _document(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise DesignError(f"a problem must be a TOML document, but it is not: {error}.") from None


def _problem(document: dict[str, Any], folder: Path) -> tuple[str, Scenario, list[Requirement]]:
    """Title, scenario at the start, and the objectives and constraints of a problem of either kind."""
    from .control.files import TABLE, read_control  # here, because other searches do not need optimal control

    if TABLE in document:
        control = read_control(document, folder)
        scenario = read_document(scenario_document(document["scenario"], folder, DesignError))
        return control.title, scenario, _requirements(control.problem)
    title, problem, *_ = problem_of(document, folder)
    space = problem.space
    return title, space.scenario_of(_start(space)), _requirements(problem)


def _requirements(problem: Any) -> list[Requirement]:
    return [*problem.objectives.values(), *problem.constraints.values()]


def _start(space: Any) -> Float[np.ndarray, " n"]:
    return np.asarray(space.numbers(jnp.asarray(space.start)))
