"""The sections of ``gpu.py``: each asks workers for results one by one, prints them, and goes on where one fails."""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import harness
import numpy as np
import perturbed
from workers import Budget, LostError, Worker

OURS = "jaxball"
TOLERANCES = [1e-6, 1e-10]
BALLS = [10**3, 10**4, 10**5, 10**6, 10**7]
FEW_BALLS = [10**3, 10**4]
COMPARED = 64
LORENZ, LORENZ_GRADIENTS = 524_288, 32_768
SHORTEST = 3.0  # seconds, within which no job ends
CORES_OF_A_PAIR = 4  # of two processes that compile
NO_TIME = "there is no time left"
LONG = 90.0  # seconds that a job may take; compiling for a GPU is most of it
SOURCE = "GRADSOLVE, arXiv 2609.02876, on an H200 NVL"


class Contender(NamedTuple):
    """Who solves batches: a name, the module and class or function, and the settings of its worker."""

    name: str
    place: str
    platform: str = "gpu"
    compiler: str = ""


BALL_CONTENDERS = [
    (Contender(OURS, "jaxball_batch:Vmapped"), BALLS),
    (Contender(f"{OURS}, on the CPU", "jaxball_batch:Vmapped", "cpu"), FEW_BALLS),
    (Contender("heyoka, on the CPU", "peers.heyoka_batch:Batch", "cpu"), FEW_BALLS[-1:]),  # which it builds for long
    (Contender("the same by XLA", "jaxball_batch:Vmapped", compiler="xla"), FEW_BALLS),
    (Contender("diffrax, jax.vmap", "peers.diffrax_batch:Batch"), FEW_BALLS),
]
LORENZ_CONTENDERS = [
    Contender(OURS, "gpu_timings:lorenz"),
    Contender("gradsolve, with copies", "peers.gradsolve_lorenz:lorenz"),
    Contender("diffrax, jax.vmap", "peers.diffrax_lorenz:lorenz"),
]
PUBLISHED = [
    {"solver": "gradsolve, kernel", "tolerance": 1e-6, "seconds": 0.657e-3, "error": 3e-7},
    {"solver": "gradsolve, kernel", "tolerance": 1e-8, "seconds": 1.424e-3, "error": 1e-9},
    {"solver": "gradsolve, with copies", "tolerance": 1e-8, "seconds": 7.5e-3},
    {"solver": "DiffEqGPU.jl, kernel", "tolerance": 1e-8, "seconds": 4.24e-3, "error": 2.4e-10},
]
PUBLISHED_GRADIENTS = [
    {"solver": "gradsolve", "tolerance": 1e-8, "seconds": 8.3e-3},
    {"solver": "diffrax", "tolerance": 1e-8, "seconds": 65e-3},
]
GRADIENTS = {
    "ball, Dopri8, 1e-8": [10**4, 10**5],
    "ball, RadauIIA(5), 1e-8": [10**4],
    "slip, flight and impact": [10**4],  # last, because it takes the longest to compile
}


@dataclasses.dataclass
class Session:
    """What sections share.

    - ``card``, ``cpu``: workers on the device that is measured, and on the CPU.
    - ``rows``: the most rows of anything. ``programs``: those to compare; empty for all.
    - ``losses``: what failed or was left out, and why.
    """

    budget: Budget
    card: Worker
    cpu: Worker
    rows: int
    programs: Sequence[str] = ()
    losses: list[dict] = dataclasses.field(default_factory=list)

    def ask(self, worker: Worker, what: str, place: str, *arguments: Any, at_most: float = LONG) -> Any:
        """The result of a job; None, with a line that says why, where there is none or no time for one."""
        seconds = self.budget.left(at_most)
        if seconds < SHORTEST:
            return self.lose(what, NO_TIME)
        worker.begin(place, *arguments)
        return self.receive(worker, what, seconds)

    def receive(self, worker: Worker, what: str, seconds: float) -> Any:
        """The result of a job that was begun; None, with a line that says why, where there is none in ``seconds``."""
        try:
            return worker.result(seconds)
        except LostError as loss:
            return self.lose(what, str(loss), loss.details)

    def lose(self, what: str, reason: str, details: str = "") -> None:
        """Says and records why a result is missing."""
        say(f"  {what}: none, because {reason}")
        self.losses.append({"what": what, "reason": reason, "traceback": details})

    def counts(self, rows: Sequence[int]) -> list[int]:
        """Those numbers of rows that are allowed; the most that are, if there are none."""
        return [count for count in rows if count <= self.rows] or [self.rows]


def say(line: str) -> None:
    """Prints a line at once."""
    print(line, flush=True)


def equality(session: Session) -> dict:
    """Programs on the device and on the CPU, compared to the last bit; some at a time, where there are cores for it."""
    rows = min(COMPARED, session.rows)
    say(f"\nEquality with the CPU, {rows} rows of each program")
    say(f"  {'program':26}{'numbers':>9}{'equal':>9}{'most ulp':>10}{'relative':>10}{'time':>8}  compiled by")
    names = session.programs or session.ask(session.cpu, "the programs", "gpu_programs:names") or ()
    side_by_side = max(1, min(harness.cores() // CORES_OF_A_PAIR, len(names)))
    with ThreadPoolExecutor(side_by_side) as pool:
        shares = pool.map(lambda k: _equalities(session, names[k::side_by_side], rows), range(side_by_side))
        try:
            answers = [answer for share in shares for answer in share]
        except BaseException:
            session.budget.stop()  # Ctrl-C, after which the pool waits for what has begun
            raise
    equal = sum(answer["equal"] == answer["numbers"] for answer in answers)
    say(f"  {equal} of {len(answers)} programs are equal to the last bit.")
    return {"rows": rows, "programs": answers}


def _equalities(session: Session, names: Sequence[str], rows: int) -> list[dict]:
    """One program after another, by a worker on the device and one on the CPU that compile it at the same time."""
    answers = []
    with Worker(session.card.platform) as device, Worker("cpu") as host:
        for name in names:
            start, seconds = time.monotonic(), session.budget.left(LONG)
            if seconds < SHORTEST:
                session.lose(name, NO_TIME)
                continue
            host.begin("gpu_programs:outcome", name, rows)
            found = session.ask(device, name, "gpu_programs:outcome", name, rows)
            spent = time.monotonic() - start
            expected = session.receive(host, f"{name}, on the CPU", seconds - spent + SHORTEST)
            if found is not None and expected is not None:
                answers.append({"program": name, "compiler": found[0], "time": spent, **compare(found[1], expected[1])})
                say(_equality_line(answers[-1]))
    return answers


def compare(some: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> dict:
    """How many ``numbers`` there are, how many are ``equal``, and the largest differences of the others.

    ``ulp`` is in units of the last place, ``relative`` to the largest number of the same array. Two NaN are equal;
    ``unlike`` counts a NaN beside a number, infinities, integers and truth values that differ.
    """
    answer: dict[str, Any] = {"numbers": 0, "equal": 0, "ulp": 0.0, "relative": 0.0, "unlike": 0}
    for a, b in zip(some, others, strict=True):
        floating = a.dtype.kind == "f"
        same = np.equal(a, b) | (np.isnan(a) & np.isnan(b)) if floating else np.equal(a, b)
        near = ~same & np.isfinite(a) & np.isfinite(b) if floating else np.zeros_like(same)
        answer["numbers"] += a.size
        answer["equal"] += int(np.sum(same))
        answer["unlike"] += int(np.sum(~same & ~near))
        if np.any(near):
            size = np.max(np.abs(b[np.isfinite(b)]))
            answer["ulp"] = max(answer["ulp"], float(np.max(ulps(a[near], b[near]))))
            answer["relative"] = max(answer["relative"], float(np.max(np.abs(a - b)[near]) / (size or 1.0)))
    return answer


def ulps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """How many numbers of float64 apart two arrays are."""
    return np.abs(_rank(a) - _rank(b))


def _rank(x: np.ndarray) -> np.ndarray:
    """The place of each number among those of float64, counted from zero, in extended precision where there is one."""
    bits = np.asarray(x, np.float64).view(np.int64)
    return np.where(bits < 0, -(bits & np.int64(2**63 - 1)), bits).astype(np.longdouble)


def _equality_line(answer: dict) -> str:
    unlike = f", {answer['unlike']} unlike" if answer["unlike"] else ""
    return (
        f"  {answer['program']:26}{answer['numbers']:>9}{answer['equal']:>9}{answer['ulp']:>10.3g}"
        f"{answer['relative']:>10.1e}{answer['time']:>6.1f} s  {answer['compiler']}{unlike}"
    )


def ball(session: Session) -> dict:
    """The paper's ball in batches, at two tolerances, by several contenders."""
    say("\nThe paper's ball, t = 0 ... 20, perturbed q and Omega; the largest component of (q, Omega, z) that is off")
    answers: list[dict] = []
    for contender, counts in BALL_CONTENDERS:
        with Worker(_platform(session, contender), contender.compiler) as worker:
            answers += _batches(session, worker, contender, session.counts(counts))
    return {"rows": answers}


def _batches(session: Session, worker: Worker, contender: Contender, counts: Sequence[int]) -> list[dict]:
    """Ever more rows, as long as there is time for them."""
    answers: list[dict] = []
    for rows in counts:
        what = f"{contender.name}, {rows} rows"
        if answers and (longer := _expected(answers, rows)) > session.budget.left():
            session.lose(what, f"it would take some {longer:.0f} s")
            break
        batches = session.ask(worker, what, "gpu_timings:batch", contender.place, rows, TOLERANCES, harness.cores())
        if batches is None:
            break
        exact = session.ask(session.cpu, "the reference", "gpu_timings:reference", *batches[0]["initial"])
        for batch in batches:
            error = None if exact is None else perturbed.errors(batch["states"], exact)
            answers.append(_answer(contender.name, batch, error))
            say(timing_line(answers[-1]))
    return answers


def _expected(answers: Sequence[dict], rows: int) -> float:
    """Seconds that a batch would take, compilation aside, if they grow with the rows."""
    last = [answer for answer in answers if answer["rows"] == answers[-1]["rows"]]
    return rows / last[0]["rows"] * sum((answer["calls"] + 1) * answer["seconds"] for answer in last)


def lorenz(session: Session) -> dict:
    """The table of GRADSOLVE, and gradients."""
    rows, gradients = (min(count, session.rows) for count in (LORENZ, LORENZ_GRADIENTS))
    say(f"\nLorenz' equations, t = 0 ... 1, rho = 0 ... 21, Tsit5, {rows} rows; median relative error of y(1)")
    runs = _lorenz(session, rows, [1e-6, 1e-8], "", 0)
    _say_published(PUBLISHED, LORENZ)
    say(f"\nGradients of |y(1)|² with respect to rho, {gradients} rows; median relative error")
    slopes = _lorenz(session, gradients, [1e-8], "_gradient", 1)
    _say_published(PUBLISHED_GRADIENTS, LORENZ_GRADIENTS)
    published = {"source": SOURCE, "runs": PUBLISHED, "gradients": PUBLISHED_GRADIENTS}
    return {"runs": runs, "gradients": slopes, "published": published}


def _lorenz(session: Session, rows: int, tolerances: Sequence[float], suffix: str, part: int) -> list[dict]:
    answers = []
    for contender in LORENZ_CONTENDERS:
        with Worker(_platform(session, contender), contender.compiler) as worker:
            for tolerance in tolerances:
                what = f"{contender.name}, {tolerance:.0e}"
                solved = session.ask(worker, what, contender.place + suffix, rows, tolerance)
                if solved is None:
                    break
                exact = session.ask(session.cpu, "the reference", "gpu_timings:lorenz_reference", solved["initial"])
                error = None if exact is None else relative_errors(solved["states"], exact[part])
                answers.append(_answer(contender.name, {**solved, "tolerance": tolerance}, error))
                say(timing_line(answers[-1]))
    return answers


def relative_errors(found: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Those of all components; where one is zero, its error is divided by GRADSOLVE's smallest number."""
    return np.abs(found - exact) / np.maximum(np.abs(exact), 1e-30)


def _say_published(published: Sequence[dict], rows: int) -> None:
    say(f"  published with {rows} rows ({SOURCE}):")
    for row in published:
        error = f"{row['error']:>10.1e}" if "error" in row else ""
        say(f"    {row['solver']:26}{row['tolerance']:>8.0e}{1e3 * row['seconds']:>12.3f} ms{'':15}{error}")


def gradients(session: Session) -> dict:
    """Gradients of runs, and how many runs one of them costs."""
    say("\nGradients by reverse mode: rows per second, and the time of one in runs")
    answers: list[dict] = []
    for name, counts in GRADIENTS.items():
        for rows in session.counts(counts):
            what = f"{name}, {rows} rows"
            solved = session.ask(session.card, what, "gpu_timings:gradient", name, rows, at_most=math.inf)
            if solved is None:
                break
            answers.append({"program": name, **solved, "rate": rows / solved["seconds"]})
            say(_gradient_line(answers[-1]))
    return {"rows": answers}


def _gradient_line(answer: dict) -> str:
    unknown = f"; {answer['unknown']} not known" if answer["unknown"] else ""
    return (
        f"  {answer['program']:26}{answer['rows']:>9}{answer['seconds']:>10.4f} s{answer['rate']:>14,.0f}/s"
        f"{answer['ratio']:>7.1f} runs  compiled in {answer['compile']:.1f} s by {answer['compiler']}{unknown}"
    )


def _platform(session: Session, contender: Contender) -> str:
    return "cpu" if contender.platform == "cpu" else session.card.platform


def _answer(name: str, solved: dict, error: np.ndarray | None) -> dict:
    """What is kept of a solved batch. Errors of rows that failed are not counted, but such rows are."""
    good = np.empty(0) if error is None else error[np.isfinite(error)]
    kept = {key: value for key, value in solved.items() if key not in ("states", "initial")}
    return {
        "solver": name,
        **kept,
        "rate": solved["rows"] / solved["seconds"],
        "error_median": float(np.median(good)) if good.size else None,
        "error_max": float(np.max(good)) if good.size else None,
        "failed": int(np.sum(~np.isfinite(solved["states"].reshape(len(solved["states"]), -1)).all(axis=1))),
    }


def timing_line(row: dict) -> str:
    """A row in words and numbers."""
    median, largest = (
        f"{row[key]:>9.1e}" if row[key] is not None else f"{'?':>9}" for key in ("error_median", "error_max")
    )
    compiled = "" if row["compile"] is None else f"  compiled in {row['compile']:.1f} s"
    first = "" if row["first"] is None else f", first call {row['first']:.2f} s"
    whose = f", by {row['compiler']}" if row["compiler"] else ""
    failed = f", {row['failed']} failed" if row["failed"] else ""
    return (
        f"  {row['solver']:22}{row['rows']:>9}{row['tolerance']:>8.0e}{1e3 * row['seconds']:>12.3f} ms"
        f"{row['rate']:>13,.0f}/s{median}{largest}{compiled}{first}{whose}{failed}"
    )


SECTIONS: dict[str, tuple[Callable[[Session], dict], float]] = {
    "equality": (equality, 3.0),
    "ball": (ball, 3.0),
    "lorenz": (lorenz, 1.5),
    "gradients": (gradients, 2.5),
}
