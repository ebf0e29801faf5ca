"""The benchmark from names to files."""

import dataclasses
import datetime
import json
import time
from collections.abc import Sequence
from pathlib import Path

from ..interface.output import replacing
from ..interface.wording import counted
from . import report
from .contenders import FAMILIES, Contender
from .formatting import power, seconds
from .machine import description
from .measure import Echo, Measured, Row, Settings, measure
from .problem import Problem

ABOUT = "The achieved error and the time of solvers on initial value problems; times in seconds."


@dataclasses.dataclass(frozen=True)
class Bench:
    """The measurements, problem by problem; ``interrupted`` if the user stopped it before the end.

    **Arguments:**

    - ``results``: by the name of a problem.
    """

    results: dict[str, Measured]
    interrupted: bool

    @property
    def rows(self) -> list[Row]:
        """All rows."""
        return [row for measured in self.results.values() for row in measured.rows]


def bench(
    problems: Sequence[Problem], contenders: Sequence[Contender], settings: Settings, out: Path, echo: Echo = print
) -> Bench:
    """Measures ``contenders`` on ``problems``, and writes the results to the folder ``out``.

    After each problem ``results.json`` and ``table.md`` are rewritten and the problem's diagram is drawn, so that an
    interruption with Ctrl-C, after which this returns, loses at most one problem.

    **Arguments:**

    - ``settings``: those of the measurement.
    - ``echo``: called with each line of progress.

    **Raises:** :class:`~jaxball.results.OutputError` when a file cannot be written.
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
    done = f"{counted(solvers, 'solver')}, {counted(len(good), 'setting')}"
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
