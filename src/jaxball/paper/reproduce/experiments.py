"""Measures what a solver needs for the paper's two runs, and its error from their references; tables of this.

``run`` chooses the solvers and writes the tables.
"""

import dataclasses
import json
import platform
import statistics
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar, cast

import diffrax
import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from ... import paper
from ...interface.output import write_text
from ...physics.body import System
from ...programs.program import compile_quickly
from ...simulation.simulate import simulate
from ...simulation.solvers.mass import AbstractMassTerm, mass_term, unwrap
from ...simulation.solvers.wrapping import AbstractWrappingSolver
from ...simulation.trajectory import Trajectory
from .. import reference
from ..reference import Reference

Field = Callable[[Any, Any, Any], Any]
SOLVERS: dict[str, diffrax.AbstractAdaptiveSolver] = {
    "Dopri5": diffrax.Dopri5(),
    "Tsit5": diffrax.Tsit5(),
    "Dopri8": diffrax.Dopri8(),
    "Kvaerno5": diffrax.Kvaerno5(),
}
WARM_CALLS = 5
MAX_STEPS = 100_000  # at the paper's tolerances, a method of order 2 takes some 25,000
PACKAGES = ("jaxball", "diffrax", "equinox", "jax", "jaxlib", "numpy")
Row = TypeVar("Row")
Whole = TypeVar("Whole")


class Counter:
    """A count on the host that a compiled solve increments."""

    def __init__(self):
        self.count = 0

    def __call__(self) -> None:
        self.count += 1

    def read(self) -> int:
        """Returns the count, once every solve that was started has finished."""
        jax.effects_barrier()
        return self.count


def counting(field: Field, tick: Callable[[], None]) -> Field:
    """Returns ``field``, made to call ``tick`` on the host each time it is evaluated.

    Under ``vmap``, as over the stages of a step, it counts each of them, because it passes t and x through. A Jacobian
    is one evaluation: one pass through the field with all its tangents.
    """

    def count_call(t, x, args):
        jax.debug.callback(lambda t, x: tick(), t, x)
        return field(t, x, args)

    return count_call


class CountingTerm(diffrax.AbstractTerm):
    """``term`` itself, which calls ``tick`` on the host each time its vector field is evaluated."""

    transparent: ClassVar[bool] = True

    term: diffrax.AbstractTerm
    tick: Callable[[], None] = eqx.field(static=True)

    def vf(self, t, y, args):
        return counting(self.term.vf, self.tick)(t, y, args)

    def contr(self, t0, t1, **kwargs):
        return self.term.contr(t0, t1, **kwargs)

    def prod(self, vf, control):
        return self.term.prod(vf, control)

    def is_vf_expensive(self, t0, t1, y, args):
        return self.term.is_vf_expensive(t0, t1, y, args)


class CountingMassTerm(AbstractMassTerm):
    """``term`` itself, M ẋ = g(t, x), which calls ``tick`` on the host each time g is evaluated."""

    term: AbstractMassTerm
    tick: Callable[[], None] = eqx.field(static=True)

    def at_step(self, t, y, args):
        g, mass = self.term.at_step(t, y, args)
        return counting(g, self.tick), mass


class CountingSolver(AbstractWrappingSolver):
    """``solver`` itself, which counts its evaluations of f(t, x) or, with a mass matrix, of g(t, x) with ``tick``."""

    solver: diffrax.AbstractSolver  # pyright: ignore[reportIncompatibleVariableOverride]
    tick: Callable[[], None] = eqx.field(static=True)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(self._count(terms), t0, t1, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        return self.solver.step(self._count(terms), t0, t1, y0, args, solver_state, made_jump)

    def func(self, terms, t0, y0, args):
        return self.solver.func(self._count(terms), t0, y0, args)

    def _count(self, term: diffrax.AbstractTerm) -> diffrax.AbstractTerm:
        with_mass = mass_term(term)
        if with_mass is None:
            return CountingTerm(term, self.tick)
        # In its place, because solvers get g from it, and the direction of time from its wrappers.
        return eqx.tree_at(unwrap, term, CountingMassTerm(with_mass, self.tick))


@dataclass(frozen=True)
class Experiment:
    """A run of the paper, which starts at rest.

    **Arguments:**

    - ``name``, ``system``, ``tolerance``, ``reference``: its name, the body, the tolerance of its solves, and the exact
      states.
    - ``symbols``: the parts of the state that are compared with the reference; without angles that are prescribed in
      closed form.
    - ``dae``: whether it is solved in the differential-algebraic form, as in :func:`~jaxball.simulate`.
    """

    name: str
    system: System
    tolerance: float
    reference: Reference
    symbols: tuple[str, ...]
    dae: bool = False

    def solve(self, solver: diffrax.AbstractAdaptiveSolver) -> Trajectory:
        """Computes the trajectory at the reference's times, at each of which a step ends.

        **Raises:** :class:`~jaxball.SolveError` when the solve fails.
        """
        return simulate(
            self.system,
            self.reference.times,
            solver=solver,
            rtol=self.tolerance,
            atol=self.tolerance,
            step_to_times=True,
            dae=self.dae,
            max_steps=MAX_STEPS,
            throw=True,
        )

    def errors(self, trajectory: Trajectory) -> Float[np.ndarray, " T"]:
        """Returns the largest error of a component of the state at each of the reference's times."""
        computed = np.column_stack([np.asarray(getattr(trajectory.state, symbol)) for symbol in self.symbols])
        exact = np.column_stack([self.reference.columns(symbol) for symbol in self.symbols])
        return np.max(np.abs(computed - exact), axis=1)


@dataclass(frozen=True)
class Measurement:
    """The cost and the error of one solver in one experiment. Times are in seconds.

    - ``system``, ``solver``, ``tolerance``: the names of the system and the solver, and the tolerance.
    - ``accepted``, ``rejected``, ``evaluations``: steps and evaluations of the right-hand side. They are counted in a
      separate run, which rounds differently and may differ by a step or two.
    - ``error``, ``error_at_end``: the largest error at the saved times, and the error at the last of them.
    - ``run_time``: the median of the calls after the first; ``compile_time``: how much longer the first one took.
    """

    system: str
    solver: str
    tolerance: float
    accepted: int
    rejected: int
    evaluations: int
    error: float
    error_at_end: float
    run_time: float
    compile_time: float


def disk_experiment() -> Experiment:
    """Returns the experiment with the disk of section 4 at its tolerance."""
    return Experiment("disk", paper.disk(), paper.DISK_TOLERANCE, reference.disk(), ("phi", "phidot"))


def ball_experiment(dae: bool = False) -> Experiment:
    """Returns the experiment with the ball of section 5 at its tolerance.

    **Arguments:**

    - ``dae``: whether in the differential-algebraic form.
    """
    return Experiment("ball", paper.ball(), paper.BALL_TOLERANCE, reference.ball(), ("q", "Omega", "z"), dae)


EXPERIMENTS: dict[str, Callable[[], Experiment]] = {"disk": disk_experiment, "ball": ball_experiment}


def measure(experiment: Experiment, name: str, solver: diffrax.AbstractAdaptiveSolver) -> Measurement:
    """Measures ``experiment`` with ``solver``, which is called ``name``.

    **Raises:** :class:`~jaxball.SolveError` when the solve fails.
    """
    first, trajectory = _time_solve(experiment, solver)
    warm = statistics.median(_time_solve(experiment, solver)[0] for _ in range(WARM_CALLS))
    counter = Counter()
    with compile_quickly():
        counted = experiment.solve(CountingSolver(solver, counter))
    errors = experiment.errors(trajectory)
    return Measurement(
        system=experiment.name,
        solver=name,
        tolerance=experiment.tolerance,
        accepted=int(counted.steps - counted.rejected),
        rejected=int(counted.rejected),
        evaluations=counter.read(),
        error=float(errors.max()),
        error_at_end=float(errors[-1]),
        run_time=warm,
        compile_time=max(first - warm, 0.0),
    )


def _time_solve(experiment: Experiment, solver: diffrax.AbstractAdaptiveSolver) -> tuple[float, Trajectory]:
    start = time.perf_counter()
    trajectory = experiment.solve(solver)
    jax.block_until_ready(trajectory.state)
    return time.perf_counter() - start, trajectory


def check_names(argument: str, names: Sequence[str], known: Collection[str]) -> None:
    """Raises ``ValueError`` if ``names`` is empty, or one of them is not ``known``."""
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise ValueError(
            f"Argument `{argument}` must contain one or more of {', '.join(known)}, but it is {list(names)}."
        )


@dataclasses.dataclass(frozen=True)
class Column(Generic[Row]):
    """A column's heading and how it shows a row; words are aligned left, numbers right."""

    heading: str
    cell: Callable[[Row], str]
    width: int
    left: bool = False

    def align(self, text: str) -> str:
        """Pads ``text`` with blanks to the column's width."""
        return text.ljust(self.width) if self.left else text.rjust(self.width)

    def of(self, part: Callable[[Whole], Row]) -> "Column[Whole]":
        """Returns the same column for rows that contain such a row as a part."""
        return Column(self.heading, lambda whole: self.cell(part(whole)), self.width, self.left)


@dataclasses.dataclass(frozen=True)
class Table(Generic[Row]):
    """A table whose rows are dataclasses.

    - ``name``: of its files, without a suffix.
    - ``legend``: the paragraphs below it.
    """

    name: str
    columns: Sequence[Column[Row]]
    legend: Sequence[str]

    @property
    def files(self) -> tuple[str, str]:
        """The names of its files."""
        return f"{self.name}.md", f"{self.name}.json"

    def print_rows(self, rows: Iterable[Row], echo: Callable[[str], None]) -> list[Row]:
        """Prints all ``rows``, each as soon as it is available, and returns them."""
        titles = "  ".join(column.align(column.heading) for column in self.columns)
        echo(titles + "\n" + "  ".join("-" * column.width for column in self.columns))
        printed_rows = []
        for row in rows:
            printed_rows.append(row)
            echo("  ".join(column.align(column.cell(row)) for column in self.columns))
        return printed_rows

    def write(self, folder: Path, rows: Sequence[Row], conclusion: str, **about: Any) -> None:
        """Writes the table with its legend and ``conclusion`` as Markdown, and as JSON the rows with ``about``.

        The JSON has the rows in full precision, with the versions that made them.

        **Raises:** :class:`~jaxball.files.results.OutputError` when a file cannot be written.
        """
        versions = {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}
        content = {"versions": versions, **about, "measurements": [dataclasses.asdict(cast(Any, row)) for row in rows]}
        as_json = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
        for name, text in zip(self.files, (self._markdown(rows, conclusion), as_json), strict=True):
            write_text(folder / name, text)

    def _markdown(self, rows: Sequence[Row], conclusion: str) -> str:
        lines = [
            "| " + " | ".join(column.heading for column in self.columns) + " |",
            "|" + "|".join(":--" if column.left else "--:" for column in self.columns) + "|",
            *("| " + " | ".join(column.cell(row) for column in self.columns) + " |" for row in rows),
        ]
        return "\n\n".join(["\n".join(lines), *self.legend, conclusion]) + "\n"


# The columns that the tables share.
STEPS: tuple[Column[Measurement], ...] = (
    Column("Accepted", lambda m: str(m.accepted), 8),
    Column("Rejected", lambda m: str(m.rejected), 8),
    Column("Evaluations", lambda m: str(m.evaluations), 11),
    Column("Error", lambda m: f"{m.error:.1e}", 7),
)


def agreement(measurements: Sequence[Measurement], solvers: str = "") -> str:
    """Returns a sentence with the largest error of all ``solvers``, system by system; by default their names."""
    systems = dict.fromkeys(m.system for m in measurements)
    parts = [f"{max(m.error for m in measurements if m.system == system):.1e} for the {system}" for system in systems]
    solvers = solvers or ", ".join(dict.fromkeys(m.solver for m in measurements))
    return f"Agreement with the paper's runs: the largest error of {solvers} is {' and '.join(parts)}."
