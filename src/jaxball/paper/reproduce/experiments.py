"""One run of the paper with one solver: what it costs and how exact it is."""

import statistics
import time
from dataclasses import dataclass

import diffrax
import jax
import numpy as np
from jaxtyping import Float

from ... import paper
from ...physics.body import System
from ...simulation.simulate import simulate
from ...simulation.trajectory import Trajectory
from .. import reference
from ..reference import Reference
from .evaluations import Counter, CountingSolver

SOLVERS: dict[str, diffrax.AbstractAdaptiveSolver] = {
    "Dopri5": diffrax.Dopri5(),
    "Tsit5": diffrax.Tsit5(),
    "Dopri8": diffrax.Dopri8(),
    "Kvaerno5": diffrax.Kvaerno5(),
}
WARM_CALLS = 5


@dataclass(frozen=True)
class Experiment:
    """A run of the paper: a system that starts at rest, the tolerance, and the exact states.

    ``symbols`` are the parts of the state that are compared with the reference; angles that are
    prescribed in closed form are not among them.

    **Arguments:**

    - ``name``, ``system``, ``tolerance``, ``reference``: what it is called, the body, the tolerance of its solves,
      and the exact states.
    """

    name: str
    system: System
    tolerance: float
    reference: Reference
    symbols: tuple[str, ...]

    def solve(self, solver: diffrax.AbstractAdaptiveSolver) -> Trajectory:
        """The trajectory at the reference's times, each of which the solver steps to.

        **Raises:** :class:`~jaxball.SolveError` when the solve fails.
        """
        return simulate(
            self.system,
            self.reference.times,
            solver=solver,
            rtol=self.tolerance,
            atol=self.tolerance,
            step_to_times=True,
            throw=True,
        )

    def errors(self, trajectory: Trajectory) -> Float[np.ndarray, " T"]:
        """The error of the largest component of the state at each of the reference's times."""
        found = [np.asarray(getattr(trajectory.state, symbol)) for symbol in self.symbols]
        found = np.column_stack(found)
        exact = np.column_stack([self.reference.columns(symbol) for symbol in self.symbols])
        return np.max(np.abs(found - exact), axis=1)


@dataclass(frozen=True)
class Measurement:
    """What one solver did in one experiment. Times are in seconds.

    - ``system``, ``solver``, ``tolerance``: what was solved, by what, and how exactly.
    - ``accepted``, ``rejected``, ``evaluations``: steps, and evaluations of the right-hand side, all
      counted in a run of its own, which rounds differently and may differ by a step or two.
    - ``error``: the largest at the saved times; ``error_at_end``: at the last of them.
    - ``run_time``: the median of calls after the first; ``compile_time``: what the first took longer.
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
    """The disk of section 4 at its tolerance."""
    return Experiment("disk", paper.disk(), paper.DISK_TOLERANCE, reference.disk(), ("phi", "phidot"))


def ball_experiment() -> Experiment:
    """The ball of section 5 at its tolerance."""
    return Experiment("ball", paper.ball(), paper.BALL_TOLERANCE, reference.ball(), ("q", "Omega", "z"))


def measure(experiment: Experiment, solver_name: str) -> Measurement:
    """Solves ``experiment`` with the solver of that name in :data:`SOLVERS`, several times.

    **Raises:** :class:`~jaxball.SolveError` when the solve fails.
    """
    solver = SOLVERS[solver_name]
    first, trajectory = _timed(experiment, solver)
    warm = statistics.median(_timed(experiment, solver)[0] for _ in range(WARM_CALLS))
    counter = Counter()
    counted = experiment.solve(CountingSolver(solver, counter))
    errors = experiment.errors(trajectory)
    return Measurement(
        system=experiment.name,
        solver=solver_name,
        tolerance=experiment.tolerance,
        accepted=int(counted.steps - counted.rejected),
        rejected=int(counted.rejected),
        evaluations=counter.read(),
        error=float(errors.max()),
        error_at_end=float(errors[-1]),
        run_time=warm,
        compile_time=max(first - warm, 0.0),
    )


def _timed(experiment: Experiment, solver: diffrax.AbstractAdaptiveSolver) -> tuple[float, Trajectory]:
    start = time.perf_counter()
    trajectory = experiment.solve(solver)
    jax.block_until_ready(trajectory.state)
    return time.perf_counter() - start, trajectory
