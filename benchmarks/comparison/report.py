"""Tables of the rows: which solver is fastest at an achieved error, and whether all agree."""

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from .measure import Measured, Row, power, seconds
from .problem import Problem

GOALS = (1e-6, 1e-8, 1e-10, 1e-12)
COLUMNS = (
    "Solver", "Tolerance", "Error", "Time", "Ratio", "Build",
    "Steps", "Rejected", "Evaluations", "Jacobians", "Decompositions",
)  # fmt: skip
ABOUT = (
    "Achieved errors relative to reference solutions, medians of warm calls, without build or compile time. For each "
    "bound on the achieved error, the fastest setting of each solver; *ratio* is its time over that of the fastest. A "
    "dash means that a package does not report the number."
)


class Spread(NamedTuple):
    """The largest difference between two final states, in the norm of the error, and their solvers."""

    difference: float
    solvers: tuple[str, str]


def cheapest(rows: Sequence[Row], goal: float) -> list[Row]:
    """The fastest row of each solver with an achieved error of at most ``goal``; the fastest solver first."""
    good = [(row.time, row) for row in rows if row.error is not None and row.error <= goal and row.time is not None]
    fastest: dict[str, Row] = {}
    for _, row in sorted(good, key=lambda pair: pair[0]):
        fastest.setdefault(row.solver, row)
    return list(fastest.values())


def select_rows(rows: Sequence[Row], goal: float) -> list[Row]:
    """Selects the row of each solver with the loosest tolerance that is not above ``goal``."""
    good = [row for row in rows if not row.failure and row.tolerance <= goal]
    return list({row.solver: row for row in sorted(good, key=lambda row: row.tolerance)}.values())


def spread(problem: Problem, rows: Sequence[Row]) -> Spread | None:
    """The spread of the final states of ``rows``; None for fewer than two."""
    indices = list(problem.measured)
    scale = np.abs(np.asarray(problem.exact)[indices]) if problem.relative else 1.0
    states = {row.solver: np.asarray(row.state)[indices] / scale for row in rows if row.state is not None}
    pairs = itertools.combinations(states, 2)
    return max((Spread(float(np.max(np.abs(states[a] - states[b]))), (a, b)) for a, b in pairs), default=None)


def markdown(problems: Sequence[Problem], results: Mapping[str, Measured]) -> str:
    """The tables of all problems with results."""
    done = [problem for problem in problems if problem.name in results]
    parts = ["# Solvers compared", ABOUT, _summary(done, results)]
    for problem in done:
        parts += _section(problem, results[problem.name])
    return "\n\n".join(parts) + "\n"


def _summary(problems: Sequence[Problem], results: Mapping[str, Measured]) -> str:
    """The fastest solver of each problem at each goal."""
    lines = [_line(["Fastest for an error of at most", *(power(goal) for goal in GOALS)]), _rule(1, len(GOALS))]
    for problem in problems:
        best = [cheapest(results[problem.name].rows, goal)[:1] for goal in GOALS]
        cells = [f"{rows[0].solver}, {seconds(rows[0].time or 0.0)}" if rows else "–" for rows in best]
        lines.append(_line([problem.title, *cells]))
    return "\n".join(lines)


def _section(problem: Problem, measured: Measured) -> list[str]:
    kind = "largest relative" if problem.relative else "largest"
    parts = [
        f"## {problem.title}",
        f"t from {problem.start:g} to {problem.end:g}; the error is the {kind} one of the compared components at the "
        f"end. Reference: {problem.source}.",
    ]
    for goal in GOALS:
        rows = cheapest(measured.rows, goal)
        if rows:
            parts += [f"### Achieved error at most {power(goal)}", _table(rows)]
            parts.append(_agreement(problem, measured.rows, goal))
    omitted = [f"- {sentence}" for sentence in (*measured.left_out, *_failures(measured.rows))]
    return [*parts, "### Left out and failed", "\n".join(omitted)] if omitted else parts


def _failures(rows: Sequence[Row]) -> list[str]:
    """A sentence for each solver and each way in which it failed."""
    alike: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if row.failure:
            alike.setdefault((row.solver, row.failure), []).append(row)
    return [
        f"Failed: {solver} at {', '.join(power(row.tolerance) for row in failed)}, because {failure}."
        for (solver, failure), failed in alike.items()
    ]


def _table(rows: Sequence[Row]) -> str:
    fastest = rows[0].time or 0.0
    return "\n".join([_line(COLUMNS), _rule(1, len(COLUMNS) - 1), *(_line(_cells(row, fastest)) for row in rows)])


def _cells(row: Row, fastest: float) -> list[str]:
    counts = (row.steps, row.rejected, row.evaluations, row.jacobians, row.decompositions)
    assert row.time is not None
    assert row.error is not None
    return [
        row.solver,
        power(row.tolerance),
        power(row.error, 2),
        seconds(row.time),
        f"{row.time / fastest:.2f}",
        seconds(row.build_time),
        *("–" if count is None else str(count) for count in counts),
    ]


def _agreement(problem: Problem, rows: Sequence[Row], goal: float) -> str:
    sentences = [
        _apart(spread(problem, cheapest(rows, goal)), "The final states of these solvers"),
        _apart(
            spread(problem, select_rows(rows, goal)), f"The final states of all solvers at the tolerance {power(goal)}"
        ),
    ]
    return " ".join(filter(None, sentences))


def _apart(apart: Spread | None, whose: str) -> str:
    if apart is None:
        return ""
    farthest = " and ".join(apart.solvers)
    return f"{whose} lie within {power(apart.difference, 2)} of one another ({farthest} farthest apart)."


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _rule(left: int, right: int) -> str:
    return "|" + ":--|" * left + "--:|" * right
