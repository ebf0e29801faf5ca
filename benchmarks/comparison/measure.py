"""Times, errors and work of contenders that solve one problem, and the machine on which they are measured."""

import functools
import importlib.metadata
import itertools
import math
import os
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from jaxball.interface.wording import number_of

from .contenders import Contender, Program, Run
from .problem import Problem

Result = TypeVar("Result")
Echo = Callable[[str], None]

ROUNDS = 5
FEWEST_CALLS, MOST_CALLS = 3, 50
COLD = 0.05  # seconds, compared with which the effect of cold caches on a call is negligible
PACKAGES = (
    "jaxball", "jax", "jaxlib", "diffrax", "equinox", "optimistix", "numpy",
    "scipy", "numba", "numbalsoda", "heyoka", "casadi",
)  # fmt: skip
VECTOR_UNITS = ("sse4_2", "avx", "avx2", "fma", "avx512f", "avx512dq", "asimd", "sve")


@dataclass(frozen=True)
class Settings:
    """The settings of a measurement.

    - ``tolerances``: the relative tolerances.
    - ``budget``: seconds of timed calls for each contender and tolerance.
    - ``limit``: seconds that a solve may take; a slower one is left out, and so are its tighter tolerances.
    """

    tolerances: tuple[float, ...]
    budget: float
    limit: float


@dataclass(frozen=True)
class Row:
    """One contender at one tolerance. Times are in seconds.

    - ``failure``: empty, or how the solve failed, in which case there is no error and no time.
    - ``error``: the achieved one, :meth:`Problem.error` of the final state.
    - ``time``, ``quartiles``, ``repeats``: the median of warm calls, their quartiles, and their number.
    - ``build_time``: to build or compile what the solve needs, shared parts included.
    - ``state``: the final state.
    - ``steps`` and the fields after it: see ``Work`` in ``comparison.contenders``.
    - ``problem``, ``solver``, ``family``, ``tolerance``: what was solved, by which method of which package, and at
      which tolerance.
    - ``rejected``, ``evaluations``, ``jacobians``, ``decompositions``: the work done; None where the package does not
      report it.
    """

    problem: str
    solver: str
    family: str
    tolerance: float
    failure: str = ""
    error: float | None = None
    time: float | None = None
    quartiles: tuple[float, float] | None = None
    repeats: int = 0
    build_time: float = 0.0
    state: tuple[float, ...] | None = None
    steps: int | None = None
    rejected: int | None = None
    evaluations: int | None = None
    jacobians: int | None = None
    decompositions: int | None = None

    @classmethod
    def of(cls, problem: Problem, contender: Contender, tolerance: float, build_time: float, **found: Any) -> "Row":
        """The row of a solve, with what was ``found``; without more than a ``failure`` it has no error and no times."""
        return cls(problem.name, contender.name, contender.family.name, tolerance, build_time=build_time, **found)


@dataclass
class Measured:
    """The ``rows`` of one problem, and sentences for what was ``left_out``."""

    rows: list[Row] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)


@dataclass
class _Entry:
    """A solve that takes part in the timing."""

    contender: Contender
    tolerance: float
    run: Run
    build_time: float
    once: float
    times: list[float] = field(default_factory=list)


def measure(problem: Problem, contenders: Sequence[Contender], settings: Settings, echo: Echo) -> Measured:
    """Solves ``problem`` with every one of ``contenders`` that can, at every tolerance.

    First each is built and solves once; then all take turns, a block of calls at a time, so that a drift of the
    machine's speed affects all equally; last come the untimed solves that yield errors and work.
    """
    measured = Measured()

    def leave_out(sentence: str) -> None:
        measured.left_out.append(sentence)
        echo(f"  {sentence}")

    refusals = {contender.name: contender.refusal(problem) for contender in contenders}
    for reason in dict.fromkeys(filter(None, refusals.values())):
        leave_out(f"Left out as {reason}: {', '.join(name for name in refusals if refusals[name] == reason)}.")
    entries: list[_Entry] = []
    for contender in contenders:
        if refusals[contender.name] is not None:
            continue
        built, failures = _build(problem, contender, settings, leave_out)
        if built:
            echo(f"  {contender.name}: {number_of(len(built), 'setting')}, built in {seconds(built[0].build_time)}")
        entries += built
        measured.rows += failures
    time_in_turns(entries, settings.budget)
    measured.rows += [_row(problem, entry) for entry in entries]
    order = {contender.name: place for place, contender in enumerate(contenders)}
    measured.rows.sort(key=lambda row: (order[row.solver], -row.tolerance))
    return measured


def _build(
    problem: Problem, contender: Contender, settings: Settings, leave_out: Echo
) -> tuple[list[_Entry], list[Row]]:
    """The solves of one contender within the limit, and rows for those that raised an exception."""
    entries, failures = [], []
    try:
        program = contender.program(problem)
    except Exception as error:  # whatever a package raises, the others must still be measured
        leave_out(f"Left out: {contender.name}, because building the problem failed: {cause(error)}.")
        return [], []
    for tolerance in sorted(settings.tolerances, reverse=True):
        try:
            entry = _entry(contender, program, tolerance)
        except Exception as error:
            failures.append(Row.of(problem, contender, tolerance, program.build_time, failure=cause(error)))
            continue
        if entry.once > settings.limit:
            leave_out(
                f"Left out: {contender.name} at tolerance {power(tolerance)} and tighter ones, because a solve took "
                f"{entry.once:.1f} s, more than {settings.limit:g} s."
            )
            break
        entries.append(entry)
    return entries, failures


def _entry(contender: Contender, program: Program, tolerance: float) -> _Entry:
    own_time, run = time_call(lambda: program.run(tolerance))
    first, _ = time_call(run.solve)
    once = first if first > 1 else time_call(run.solve)[0]
    return _Entry(contender, tolerance, run, program.build_time + own_time, once)


def time_in_turns(entries: Sequence[_Entry], budget: float) -> None:
    """Fills the times of ``entries``, in rounds of blocks; the first call of a block, with cold caches, is untimed."""
    repeats = {id(entry): min(max(int(budget / entry.once), FEWEST_CALLS), MOST_CALLS) for entry in entries}
    for _, entry in itertools.product(range(ROUNDS), entries):
        left = repeats[id(entry)] - len(entry.times)
        block = min(math.ceil(repeats[id(entry)] / ROUNDS), left)
        if block <= 0:
            continue
        if entry.once < COLD:
            entry.run.solve()
        entry.times += [time_call(entry.run.solve)[0] for _ in range(block)]


def _row(problem: Problem, entry: _Entry) -> Row:
    of = functools.partial(Row.of, problem, entry.contender, entry.tolerance, entry.build_time)
    try:
        outcome = entry.run.outcome()
    except Exception as error:
        return of(failure=cause(error))
    finite = bool(np.isfinite(outcome.state).all())
    failure = outcome.failure or ("" if finite else "the final state is not finite")
    if failure:
        return of(failure=failure)
    low, _, high = statistics.quantiles(entry.times, n=4, method="inclusive")
    return of(
        error=problem.error(outcome.state),
        time=statistics.median(entry.times),
        quartiles=(low, high),
        repeats=len(entry.times),
        state=tuple(map(float, outcome.state)),
        **vars(outcome.work),
    )


def time_call(call: Callable[[], Result]) -> tuple[float, Result]:
    """Returns the time in seconds that ``call`` took, and its result; ``call`` must wait for what it started."""
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


def cause(error: Exception) -> str:
    """The kind of ``error`` and the end of its message, where packages that nest messages put the cause."""
    lines = str(error).strip().splitlines() or ["no message"]
    return f"{type(error).__name__}: {lines[-1].rstrip('.')}"


def seconds(time: float) -> str:
    """A time with three digits in a suitable unit."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if time >= size:
            return f"{time / size:.3g} {unit}"
    return f"{time / 1e-6:.3g} μs"


def power(x: float, digits: int = 1) -> str:
    """``x`` with an exponent without leading zeros: 1e-8."""
    mantissa, _, exponent = f"{x:.{digits - 1}e}".partition("e")
    return f"{mantissa}e{int(exponent)}"


def description() -> dict[str, object]:
    """The machine, the settings of XLA, and the versions of Python and of the installed packages."""
    return {"machine": machine(), "XLA_FLAGS": os.environ.get("XLA_FLAGS", ""), "versions": versions(PACKAGES)}


def machine() -> dict[str, object]:
    """The processor, its vector units as far as the system lists them, its cores, and the system."""
    info = _processor()
    flags = info.get("flags", info.get("Features", "")).split()
    return {
        "cpu": info.get("model name") or platform.processor() or platform.machine(),
        "vector_units": [unit for unit in VECTOR_UNITS if unit in flags],
        "cores": os.cpu_count(),
        "system": platform.platform(),
    }


def versions(packages: tuple[str, ...]) -> dict[str, str]:
    """The versions of Python and of those ``packages`` that are installed."""
    known = {"python": platform.python_version()}
    for package in packages:
        try:
            known[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return known


def _processor() -> dict[str, str]:
    """What Linux says about the first processor; empty elsewhere."""
    path = Path("/proc/cpuinfo")
    if not path.exists():
        return {}
    first, _, _ = path.read_text(encoding="utf-8").partition("\n\n")
    pairs = (line.partition(":") for line in first.splitlines())
    return {key.strip(): value.strip() for key, _, value in pairs}
