"""The extent of a run of the benchmark: everything, a quick part, or the named problems and solvers."""

import dataclasses
import datetime
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from jaxball.interface.output import replacing
from jaxball.interface.wording import nearest, number_of

from . import problems, report
from .contenders import ALL, FAMILIES, Contender
from .measure import Echo, Measured, Row, Settings, description, measure, power, seconds
from .problem import Problem

FULL = Settings(tuple(10.0**-k for k in range(4, 14)), budget=0.2, limit=5.0)
QUICK = Settings((1e-5, 1e-8), budget=0.02, limit=2.0)
QUICK_PROBLEMS = ("ball", "robertson")
NEAREST = 3
QUICK_SOLVERS = ("Gauss", "RadauIIA 3", "diffrax Dopri8", "SciPy DOP853", "heyoka Taylor", "CasADi CVODES BDF")
ABOUT = "The achieved error and the time of solvers on initial value problems; times in seconds."


class Plan(NamedTuple):
    """The ``problems`` and ``contenders`` to measure, and the ``settings`` of the measurement."""

    problems: list[Problem]
    contenders: list[Contender]
    settings: Settings


def plan(problem_names: Sequence[str] = (), solver_names: Sequence[str] = (), *, quick: bool = False) -> Plan:
    """The problems and solvers with the names in ``problem_names`` and ``solver_names``.

    Without names they are all, or the few that are ``quick``.

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
    """The problems with these ``names``, in the order of ``known``; all if there are no names.

    **Raises:** :class:`SelectionError` for a name that no problem has.
    """
    chosen = {key for name in names for key in _matching("problems", name, {key: (key,) for key in known})}
    return [problem for key, problem in known.items() if not names or key in chosen]


def select_contenders(names: Sequence[str]) -> list[Contender]:
    """The contenders with these ``names``, in the order of the list of them; all if there are no names.

    A name may also consist of whole words of one, or be the package: "RadauIIA" selects all of its stage numbers, and
    "SciPy" all of SciPy.

    **Raises:** :class:`SelectionError` for a name that no contender has.
    """
    labels = {key: (key, contender.family.name) for key, contender in ALL.items()}
    chosen = {key for name in names for key in _matching("solvers", name, labels)}
    return [contender for key, contender in ALL.items() if not names or key in chosen]


def _matching(argument: str, name: str, labels: Mapping[str, tuple[str, ...]]) -> list[str]:
    """The keys whose label is ``name``, or otherwise those that contain its words in sequence."""
    exact = [key for key in labels if key.lower() == name.lower()]
    matches = exact or [key for key, values in labels.items() if any(_has_words(value, name) for value in values)]
    if not matches:
        known = dict.fromkeys(label for values in labels.values() for label in values)
        raise SelectionError(
            f"Argument `{argument}` must contain names that `python -m benchmarks --list` shows, but it contains "
            f"{name!r}; {_suggestion(name, known)}."
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


@dataclasses.dataclass(frozen=True)
class Bench:
    """The ``results``, by the name of a problem; ``interrupted`` if the user stopped it before the end."""

    results: dict[str, Measured]
    interrupted: bool

    @property
    def rows(self) -> list[Row]:
        """All rows."""
        return [row for measured in self.results.values() for row in measured.rows]


def compare(
    problems: Sequence[Problem], contenders: Sequence[Contender], settings: Settings, out: Path, echo: Echo = print
) -> Bench:
    """Measures ``contenders`` on ``problems`` with ``settings``, and writes the results to the folder ``out``.

    After each problem ``results.json`` and ``table.md`` are rewritten and the problem's diagram is drawn, so that an
    interruption with Ctrl-C, after which this returns, loses at most one problem. ``echo`` is called with each line of
    progress.

    **Raises:** :class:`~jaxball.files.results.OutputError` when a file cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    present, missing = _present(contenders)
    for sentence in missing:
        echo(sentence)
    results: dict[str, Measured] = {}
    interrupted = False
    for problem in problems:
        echo(problem.title)
        start = time.perf_counter()
        try:
            results[problem.name] = measure(problem, present, settings, echo)
        except KeyboardInterrupt:
            echo(f"Interrupted while measuring {problem.name}, whose results are discarded.")
            interrupted = True
            break
        echo(f"  {_finding(results[problem.name].rows)} ({time.perf_counter() - start:.0f} s)")
        _write(out, problems, results, settings, missing)
    echo(f"In {out}: results.json, table.md and a diagram for each problem." if results else "Nothing was measured.")
    return Bench(results, interrupted)


def _present(contenders: Sequence[Contender]) -> tuple[list[Contender], list[str]]:
    """The contenders whose packages are installed, and a sentence for each family that is left out."""
    absent, sentences = set(), []
    for family in FAMILIES:
        names = [contender.name for contender in contenders if contender.family == family]
        reason = family.missing() if names else None
        if reason is not None:
            absent.add(family)
            sentences.append(f"Left out: {', '.join(names)}, because {reason}; {family.remedy}.")
    return [contender for contender in contenders if contender.family not in absent], sentences


def _finding(rows: Sequence[Row]) -> str:
    good = [row for row in rows if not row.failure]
    solvers = len({row.solver for row in good})
    done = f"{number_of(solvers, 'solver')}, {number_of(len(good), 'setting')}"
    for goal in reversed(report.GOALS):
        cheapest = report.cheapest(rows, goal)
        if cheapest:
            return f"{done}; fastest to {power(goal)}: {cheapest[0].solver}, {seconds(cheapest[0].time or 0.0)}"
    return f"{done}, none with an error of at most {power(report.GOALS[0])}"


def _write(
    out: Path, problems: Sequence[Problem], results: dict[str, Measured], settings: Settings, missing: list[str]
) -> None:
    from . import figures  # only here, because matplotlib takes longer to import than to list names

    content = {
        "about": ABOUT,
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        **description(),
        "settings": dataclasses.asdict(settings),
        "missing": missing,
        "problems": {problem.name: _about(problem, results) for problem in problems if problem.name in results},
        "rows": [dataclasses.asdict(row) for measured in results.values() for row in measured.rows],
    }
    with replacing(out / "results.json") as beside:
        beside.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    with replacing(out / "table.md") as beside:
        beside.write_text(report.markdown(problems, results), encoding="utf-8")
    latest = problems[len(results) - 1]
    figures.draw(latest, results[latest.name].rows, out)


def _about(problem: Problem, results: dict[str, Measured]) -> dict[str, object]:
    return {
        "title": problem.title,
        "source": problem.source,
        "start": problem.start,
        "end": problem.end,
        "kinks": problem.kinks,
        "measured": problem.measured,
        "relative_error": problem.relative,
        "atol_over_rtol": problem.atol_over_rtol,
        "left_out": results[problem.name].left_out,
    }
