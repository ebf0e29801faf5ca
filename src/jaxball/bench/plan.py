"""The extent of a run of the benchmark: everything, a quick part, or the named problems and solvers."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from ..interface.wording import nearest
from . import problems
from .contenders import ALL, FAMILIES, Contender
from .measure import Settings
from .problem import Problem

FULL = Settings(tuple(10.0**-k for k in range(4, 14)), budget=0.2, limit=5.0)
QUICK = Settings((1e-5, 1e-8), budget=0.02, limit=2.0)
QUICK_PROBLEMS = ("ball", "robertson")
NEAREST = 3
QUICK_SOLVERS = ("Gauss", "RadauIIA 3", "diffrax Dopri8", "SciPy DOP853", "heyoka Taylor", "CasADi CVODES BDF")


class Plan(NamedTuple):
    """The solvers and problems to measure, and the settings.

    **Arguments:**

    - ``problems``, ``contenders``, ``settings``: lists of both, and the settings of the measurement.
    """

    problems: list[Problem]
    contenders: list[Contender]
    settings: Settings


def plan(problem_names: Sequence[str] = (), solver_names: Sequence[str] = (), *, quick: bool = False) -> Plan:
    """The problems and solvers with these names; without names all of them, or the quick ones.

    **Arguments:**

    - ``problem_names``, ``solver_names``: which; all if empty.
    - ``quick``: whether to use the quick ones.

    **Raises:** :class:`SelectionError` for a name that no problem or solver has.
    """
    return Plan(
        select_problems(problems.ALL, problem_names or (QUICK_PROBLEMS if quick else ())),
        select_contenders(solver_names or (QUICK_SOLVERS if quick else ())),
        QUICK if quick else FULL,
    )


def listing() -> str:
    """A line for each problem and for each solver, with the reason if one cannot take part here."""
    absent = {family: family.missing() for family in FAMILIES}
    width = max(map(len, (*problems.ALL, *ALL)))
    lines = ["Problems", *(f"  {problem.name:{width}}  {problem.title}" for problem in problems.ALL.values())]
    lines += ["Solvers"]
    for contender in ALL.values():
        reason = absent[contender.family]
        note = "" if reason is None else f", left out because {reason}; {contender.family.remedy}"
        lines.append(f"  {contender.name:{width}}  {contender.family.name}{note}")
    return "\n".join(lines)


class SelectionError(ValueError):
    """No problem or solver has that name; the message is a sentence with the nearest names."""


def select_problems(known: Mapping[str, Problem], names: Sequence[str]) -> list[Problem]:
    """The problems with these names, in the order of ``known``; all if there are no names.

    **Arguments:**

    - ``names``: of problems.

    **Raises:** :class:`SelectionError` for a name that no problem has.
    """
    chosen = {key for name in names for key in _matching("problems", name, {key: (key,) for key in known})}
    return [problem for key, problem in known.items() if not names or key in chosen]


def select_contenders(names: Sequence[str], known: Mapping[str, Contender] = ALL) -> list[Contender]:
    """The contenders with these names, in the order of ``known``; all if there are no names.

    A name may also consist of whole words of one, or be the package: "RadauIIA" selects all of its stage numbers, and
    "SciPy" all of SciPy.

    **Arguments:**

    - ``names``: of contenders, or words of these.

    **Raises:** :class:`SelectionError` for a name that no contender has.
    """
    labels = {key: (key, contender.family.name) for key, contender in known.items()}
    chosen = {key for name in names for key in _matching("solvers", name, labels)}
    return [contender for key, contender in known.items() if not names or key in chosen]


def _matching(argument: str, name: str, labels: Mapping[str, tuple[str, ...]]) -> list[str]:
    """The keys whose label is ``name``, or otherwise those that contain its words in sequence."""
    exact = [key for key in labels if key.lower() == name.lower()]
    matches = exact or [key for key, values in labels.items() if any(_has_words(value, name) for value in values)]
    if not matches:
        known = dict.fromkeys(label for values in labels.values() for label in values)
        raise SelectionError(
            f"Argument `{argument}` must contain names that `jaxball bench --list` shows, but it contains {name!r}; "
            f"{_suggestion(name, known)}."
        )
    return matches


def _has_words(label: str, name: str) -> bool:
    """Whether a label contains the words of a name in sequence."""
    return bool(name.split()) and f" {' '.join(name.lower().split())} " in f" {' '.join(label.lower().split())} "


def _suggestion(name: str, known: Iterable[str]) -> str:
    known = list(known)
    near = nearest(name, known, NEAREST, cutoff=0.3)
    if len(near) == 1:
        return f"the nearest name is {near[0]}"
    return f"the nearest names are {', '.join(near)}" if near else f"the names are {', '.join(known)}"
