"""Solves the problem of a file with a table ``[control]``, and confirms the solution by a simulation."""

import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import numpy as np

from ....files.scenario import Units
from ....interface.printing import repr_html
from ....interface.wording import number_of
from ..problem.space import DesignError
from .collocation import SHARP
from .rolling import Rolling, rolling
from .solution import Resimulated, Solution
from .solve import FreeEndTime, Guess, fix_end, solve_from_guess, solve_from_guess_with_free_end

# The allowed error of a simulation, in units of the mesh's tolerance.
ALLOWED_SIMULATION_ERROR = 10.0


class ControlFile(NamedTuple):
    """The content of a problem file with a table ``[control]``.

    - ``problem``: the problem to be solved; ``easy``: the same with other weights, from which continuation starts, or
      None.
    - ``saves``: the number of save times of the scenario found.
    - ``intervals``, ``tolerance``: of the first mesh, and of :func:`mesh_errors`.
    - ``violation``: how much a constraint may be violated; ``barrier``: with which the search begins.
    - ``units``: those of the scenario, if it states them.
    - ``free_end_time``: if the end time is to be found, which has no ``easy`` problem.
    """

    title: str
    problem: Rolling
    easy: Rolling | None
    saves: int
    intervals: int
    tolerance: float
    violation: float
    barrier: float
    guess: Guess
    units: Units | None = None
    free_end_time: FreeEndTime | None = None


class Point(NamedTuple):
    """A point of the branch: its parameter from 0 to 1, and weights and means of the objectives."""

    share: float
    weights: dict[str, float]
    means: dict[str, float]


class Controlled(NamedTuple):
    """A solution and the evidence for it.

    - ``first``: the solution from which continuation started; ``solution`` itself without continuation.
    - ``curvature``: :meth:`Solution.least_curvature`, also by a free end time.
    - ``seen``: the schedules simulated by a solver of another kind.
    - ``tolerance``: of the mesh; ``violation``: of constraints.
    - ``elapsed``: how long it took, in seconds.
    - ``units``: those of the scenario, if it states them.
    - ``free_end_time``: if the end time was found.
    """

    first: Solution
    solution: Solution
    branch: tuple[Point, ...]
    curvature: float
    seen: Resimulated
    tolerance: float
    violation: float
    elapsed: float
    units: Units | None = None
    free_end_time: FreeEndTime | None = None

    _repr_html_ = repr_html

    def __repr__(self) -> str:
        seen = self.seen
        lines = [
            f"Optimal control, {'' if self.good else 'not '}confirmed: a path in "
            f"{number_of(len(self.solution.errors), 'interval')}",
            f"  its simulation is up to {seen.apart:.2g} radii away, and misses its end by {seen.missed:.2g} radii",
            f"  the least curvature is {self.curvature:.3g}: "
            f"{'a strict minimum' if self.curvature > 0 else 'no strict minimum'}",
            *(f"  {name} is violated by {by:.2g}" for name, by in self.broken.items()),
        ]
        return "\n".join(lines)

    @property
    def good(self) -> bool:
        """Whether it is a strict minimum, its simulation follows its path to rest, and the constraints hold."""
        seen = self.seen
        near = max(seen.apart, seen.speed, seen.away, seen.missed) <= ALLOWED_SIMULATION_ERROR * self.tolerance
        return self.curvature > 0 and near and not self.broken

    @property
    def broken(self) -> dict[str, float]:
        """The violated constraints, and their violations."""
        return {name: by for name, by in self.seen.violations.items() if not by <= self.violation}


def solve_control(
    file: ControlFile,
    say: Callable[[str], None] = lambda line: None,
    keep: Callable[[Solution], None] = lambda solution: None,
) -> Controlled:
    """Solves a problem: from its guess by Newton's method, and by continuation if it has an easier problem.

    Finally, the barrier of constraints is brought close to zero. An end time is free from the first solution on.

    ``say`` is called with a line for each point of the branch, and ``keep`` with the point.

    **Raises:** :class:`~jaxball.studies.design.DesignError` where no solution is found.
    """
    began = time.perf_counter()
    branch: list[Point] = []

    def visit(solution: Solution) -> None:
        objectives = rolling(solution.problem).objectives
        weights = {name: float(objective.weight) for name, objective in objectives.items()}
        branch.append(Point(solution.parameter, weights, solution.means()))
        keep(solution)
        say(_line(branch[-1]))

    def sharper(solution: Solution) -> None:
        collocation = solution.collocation
        worst = np.max(solution.violations())
        solution = fix_end(solution)
        keep(solution)
        end = "" if file.free_end_time is None else f"   end {solution.path.mesh[-1]:.8g}"
        say(f"barrier {collocation.barrier:.0e}   {collocation.steps.size} intervals   violation {worst:.1e}{end}")

    problem = file.problem
    say("compiling, and solving from the guess")
    mesh = np.linspace(float(problem.start), float(problem.end), file.intervals + 1)
    rough = _first_solution(file, file.easy or problem, mesh)
    first = fix_end(rough)
    if file.easy is None:
        visit(first)
    else:
        rough = first.continue_to(problem, file.tolerance, visit)[1]
    sharp = rough
    if rough.collocation.inequalities:
        sharp = rough.sharpen(tolerance=file.tolerance, violation=file.violation, visit=sharper)
    solution = fix_end(sharp)
    say("simulating by another solver")
    seen, curvature = solution.resimulate(), sharp.least_curvature()
    evidence = curvature, seen, file.tolerance, file.violation, time.perf_counter() - began
    return Controlled(first, solution, tuple(branch), *evidence, file.units, file.free_end_time)


def _first_solution(file: ControlFile, problem: Rolling, mesh: np.ndarray) -> Solution:
    """Finds the solution by Newton's method from the guess, or otherwise from the motion without constraints."""

    def start(problem: Rolling, guess: Guess) -> Solution:
        how = {"stages": 3, "tolerance": file.tolerance, "guess": guess, "barrier": file.barrier}
        if file.free_end_time is None:
            return solve_from_guess(problem, mesh, **how)
        return solve_from_guess_with_free_end(problem, mesh, file.free_end_time, **how)

    try:
        return start(problem, file.guess)
    except DesignError:
        if not problem.constraints:
            raise
    # Without constraints Newton's method converges more easily, and its motion is a better start than rest.
    free = start(eqx.tree_at(lambda p: p.constraints, problem, {}), file.guess).path
    try:
        return start(problem, lambda *arguments: free)
    except DesignError as error:
        raise DesignError(
            "The constraints must leave a motion near that without them, but Newton's method finds none with barriers "
            f"from {file.barrier:g} to {SHARP:g}; check whether they contradict each other or the end of the motion, "
            "or start with more intervals."
        ) from error


def _line(point: Point) -> str:
    values = "   ".join(f"{name} {value:.6g}" for name, value in point.means.items())
    return f"share {point.share:6.3f}   {values}"
