"""How ``jaxball design`` solves a problem of optimal control."""

import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import numpy as np

from ..problem.variables import DesignError
from .collocation import SHARP
from .homotopy import Guess, continued, sharpened, started
from .rolling import Rolling, rolling
from .schedules import Resimulated, resimulated
from .solution import Solution, least_curvature, means, violations

# The allowed error of a simulation, in units of the mesh's tolerance.
NEAR = 10.0


class ControlFile(NamedTuple):
    """The content of a problem file with a table ``[control]``.

    - ``problem``: the problem to be solved; ``easy``: the same with other weights, from which continuation starts, or
      None.
    - ``saves``: the number of save times of the scenario found.
    - ``intervals``, ``tolerance``: of the first mesh, and of :func:`mesh_errors`.
    - ``violation``: how much a constraint may be violated; ``barrier``: with which the search begins.
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


class Point(NamedTuple):
    """A point of the branch: its parameter from 0 to 1, and weights and means of the objectives."""

    share: float
    weights: dict[str, float]
    means: dict[str, float]


class Controlled(NamedTuple):
    """A solution and the evidence for it.

    - ``first``: the solution from which continuation started; ``solution`` itself without continuation.
    - ``curvature``: :func:`least_curvature`.
    - ``seen``: the schedules simulated by a solver of another kind.
    - ``tolerance``: of the mesh; ``violation``: of constraints.
    - ``elapsed``: how long it took, in seconds.
    """

    first: Solution
    solution: Solution
    branch: tuple[Point, ...]
    curvature: float
    seen: Resimulated
    tolerance: float
    violation: float
    elapsed: float

    @property
    def good(self) -> bool:
        """Whether it is a strict minimum, its simulation follows its path to rest, and the constraints hold."""
        seen = self.seen
        near = max(seen.apart, seen.speed, seen.away, seen.missed) <= NEAR * self.tolerance
        return self.curvature > 0 and near and not self.broken

    @property
    def broken(self) -> dict[str, float]:
        """The violated constraints, and their violations."""
        return {name: by for name, by in self.seen.violations.items() if not by <= self.violation}


def controlled(
    file: ControlFile,
    say: Callable[[str], None] = lambda line: None,
    keep: Callable[[Solution], None] = lambda solution: None,
) -> Controlled:
    """The solution of a problem: from its guess by Newton's method, and by continuation if it has an easier problem.

    Finally, the barrier of constraints is brought close to zero.

    ``say`` is called with a line for each point of the branch, and ``keep`` with the point.

    **Raises:** :class:`~jaxball.design.DesignError` where no solution is found.
    """
    began = time.perf_counter()
    branch: list[Point] = []

    def visit(solution: Solution) -> None:
        objectives = rolling(solution.problem).objectives
        weights = {name: float(one.weight) for name, one in objectives.items()}
        branch.append(Point(solution.parameter, weights, means(solution)))
        keep(solution)
        say(_line(branch[-1]))

    def sharper(solution: Solution) -> None:
        collocation = solution.collocation
        worst = np.max(violations(collocation, solution.path, solution.parameter))
        keep(solution)
        say(f"barrier {collocation.barrier:.0e}   {collocation.steps.size} intervals   violation {worst:.1e}")

    problem = file.problem
    mesh = np.linspace(float(problem.start), float(problem.end), file.intervals + 1)
    first = solution = _first_solution(file, file.easy or problem, mesh)
    if file.easy is None:
        visit(solution)
    else:
        solution = continued(first, problem, file.tolerance, visit)[1]
    if problem.constraints:
        solution = sharpened(solution, tolerance=file.tolerance, violation=file.violation, visit=sharper)
    seen, curvature = resimulated(solution), least_curvature(solution)
    elapsed = time.perf_counter() - began
    return Controlled(
        first=first,
        solution=solution,
        branch=tuple(branch),
        curvature=curvature,
        seen=seen,
        tolerance=file.tolerance,
        violation=file.violation,
        elapsed=elapsed,
    )


def _first_solution(file: ControlFile, problem: Rolling, mesh: np.ndarray) -> Solution:
    """The solution by Newton's method from the guess, or otherwise from the motion without constraints."""

    def start(problem: Rolling, guess: Guess) -> Solution:
        return started(problem, mesh, tolerance=file.tolerance, guess=guess, barrier=file.barrier)

    try:
        return start(problem, file.guess)
    except DesignError:
        if not problem.constraints:
            raise
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
