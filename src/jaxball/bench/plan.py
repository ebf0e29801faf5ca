"""What a run of the benchmark covers: everything, a quick part of it, or what is named."""

from collections.abc import Sequence
from typing import NamedTuple

from . import problems
from .contenders import ALL, FAMILIES, Contender
from .measure import Settings
from .problem import Problem
from .selection import select_contenders, select_problems

FULL = Settings(tuple(10.0**-k for k in range(4, 14)), budget=0.2, limit=5.0)
QUICK = Settings((1e-5, 1e-8), budget=0.02, limit=2.0)
QUICK_PROBLEMS = ("ball", "robertson")
QUICK_SOLVERS = ("Gauss", "RadauIIA 3", "diffrax Dopri8", "SciPy DOP853", "heyoka Taylor", "CasADi CVODES BDF")


class Plan(NamedTuple):
    """Which solvers meet which problems, and how they are measured.

    **Arguments:**

    - ``problems``, ``contenders``, ``settings``: lists of both, and how often and how exactly to measure.
    """

    problems: list[Problem]
    contenders: list[Contender]
    settings: Settings


def plan(problem_names: Sequence[str] = (), solver_names: Sequence[str] = (), *, quick: bool = False) -> Plan:
    """The problems and solvers of these names; without names all of them, or the quick ones.

    **Arguments:**

    - ``problem_names``, ``solver_names``: which; all if empty.
    - ``quick``: whether the quick ones are meant.

    **Raises:** :class:`SelectionError` for a name that no problem or solver has.
    """
    return Plan(
        select_problems(problems.ALL, problem_names or (QUICK_PROBLEMS if quick else ())),
        select_contenders(solver_names or (QUICK_SOLVERS if quick else ())),
        QUICK if quick else FULL,
    )


def listing() -> str:
    """A line for each problem and for each solver, with the reason where one cannot take part here."""
    absent = {family: family.missing() for family in FAMILIES}
    width = max(map(len, (*problems.ALL, *ALL)))
    lines = ["Problems", *(f"  {problem.name:{width}}  {problem.title}" for problem in problems.ALL.values())]
    lines += ["Solvers"]
    for contender in ALL.values():
        reason = absent[contender.family]
        note = "" if reason is None else f", left out because {reason}; {contender.family.remedy}"
        lines.append(f"  {contender.name:{width}}  {contender.family.name}{note}")
    return "\n".join(lines)
