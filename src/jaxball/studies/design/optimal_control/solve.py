"""Solves a problem of optimal control, with a given or a free end, and that of a file, with evidence for its solution.

An end is found on a mesh from ``start`` to ``end``, where t = start + σ (s − start) is the time at s, and
dx/ds = σ rate(t, x, u), dσ/ds = 0 (Betts, Practical Methods for Optimal Control, section 4.10). σ at the start is free,
so that its multiplier there vanishes. With σ found, states, controls and multipliers are those of the problem with the
end that it stands for.
"""

import dataclasses
import time
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....files.scenario import Units
from ....interface.printing import repr_html
from ....interface.wording import number_of
from ....numerics.arrays import to_array
from ..objectives import FollowTrajectory
from ..problem.requirements import AbstractRunningConstraint
from ..problem.space import DesignError
from .collocation import SHARP, Collocation, as_it_is
from .guess import require_holdable
from .problem import AbstractControlProblem, Path
from .rolling import Rolling, rolling
from .solution import Resimulated, Solution, solve_near

Guess = Callable[[Rolling, Float[np.ndarray, " N_plus_one"], int], Path]


# Of the first solution. Far from the limits of inputs Newton's method converges from rest; the shortest motion, by
# contrast, is at a limit all the time.
BARRIER_OF_TIME = 1.0


class FreeEndTime(NamedTuple):
    """An end time that is to be found.

    - ``shortest``, ``longest``: its bounds.
    - ``weight``: with ``free_end_time``, the weight of the duration over that of the scenario. It is that of the first
      mesh.
    """

    shortest: float
    longest: float
    weight: float = 1.0

    def check(self, start: float, end: float) -> None:
        """Raises a :class:`~jaxball.studies.design.DesignError` unless the bounds enclose the guess of the ``end``."""
        if not start < self.shortest < end < self.longest:
            raise DesignError(
                "Argument `free_end_time` must be the shortest and the longest end time, with the guess of the end, "
                f"{end:g}, between them and the start, {start:g}, before, but it is ({self.shortest:g}, "
                f"{self.longest:g})."
            )


def solve_from_guess(
    problem: Rolling,
    mesh: Float[np.ndarray, " N_plus_one"],
    stages: int,
    tolerance: float,
    guess: Guess,
    barrier: float,
    free: FreeEndTime | None = None,
) -> Solution:
    """Solves as :meth:`Rolling.solve` does before it lowers the barrier, from the path that ``guess`` makes.

    With a free end time it is a solution of a :class:`FreeEnd`, and that path may have σ as the last entry of its
    states.
    """
    require_holdable(problem)
    if free is None:
        collocation = Collocation((problem, problem), mesh, stages, Rolling.between, barrier)
        return solve_near(collocation, guess(problem, mesh, stages), 0.0, tolerance)
    start, end = float(mesh[0]), float(mesh[-1])
    free.check(start, end)
    least, most = ((t - start) / (end - start) for t in free[:2])
    timed = eqx.tree_at(lambda p: p.end, problem, to_array(end))
    of_share = map(to_array, (least, most, free.weight))
    stretched = FreeEnd(timed, *of_share, timed.start, timed.end, timed.softness)  # pyright: ignore[reportCallIssue]
    path = guess(timed, mesh, stages)
    if path.knots.shape[-1] == timed.initial.size:
        path = path._replace(knots=_with_share(path.knots, 1.0), nodes=_with_share(path.nodes, 1.0))
    return solve_near(Collocation(stretched, mesh, stages, as_it_is, barrier), path, 0.0, tolerance)


class FreeEnd(AbstractControlProblem):
    """A :class:`Rolling` that ends when it is best: the mean of its cost, and ``weight`` σ, is least.

    - ``problem``: what ends at its ``end`` if σ = 1.
    - ``least``, ``most``: the bounds of σ, the last entry of the state.
    """

    problem: Rolling
    least: Float[Array, ""]
    most: Float[Array, ""]
    weight: Float[Array, ""]
    start: Float[Array, ""]
    end: Float[Array, ""]
    softness: Float[Array, ""]

    @property
    def constraints(self) -> dict[str, AbstractRunningConstraint]:
        """Those of the problem."""
        return self.problem.constraints

    @property
    def controls(self) -> int:
        return self.problem.controls

    @property
    def initial(self) -> Float[Array, " n"]:
        initial = self.problem.initial
        return jnp.append(initial, jnp.ones((), initial.dtype))

    @property
    def free_at_start(self) -> tuple[int, ...]:
        return (-1,)

    def rate(self, t, x, u):
        now, stretched = self._stretch(t, x[-1])
        return jnp.append(x[-1] * stretched.rate(now, x[:-1], u), 0.0)

    def cost(self, t, x, u):
        now, stretched = self._stretch(t, x[-1])
        return stretched.cost(now, x[:-1], u) + self.weight * x[-1]

    def inequalities(self, t, x, u):
        now, stretched = self._stretch(t, x[-1])
        bounds = jnp.stack([x[-1] - self.least, self.most - x[-1]])
        return jnp.concatenate([stretched.inequalities(now, x[:-1], u), bounds])

    def conditions(self, x):
        return self.ending_after(x[-1]).conditions(x[:-1])

    def ending_after(self, share: Float[Array, ""]) -> Rolling:
        """Returns the problem with the end at this share σ of its duration, and objectives that go on until then."""
        problem = self.problem
        end = problem.start + share * (problem.end - problem.start)
        objectives = {
            name: dataclasses.replace(objective, end=end) if isinstance(objective, FollowTrajectory) else objective
            for name, objective in problem.objectives.items()
        }
        return eqx.tree_at(lambda p: (p.end, p.objectives), problem, (end, objectives))

    def _stretch(self, s: Float[Array, ""], share: Float[Array, ""]) -> tuple[Float[Array, ""], Rolling]:
        return self.start + share * (s - self.start), self.ending_after(share)


def fix_end(solution: Solution) -> Solution:
    """Returns the solution of a :class:`FreeEnd` as one of a :class:`Rolling` that ends when it does; other solutions
    as they are.
    """
    free, collocation, parts = solution.problem, solution.collocation, solution.collocation.parts(solution.y)
    if not isinstance(free, FreeEnd):
        return solution
    share = float(parts.knots[0, -1])
    problem = free.ending_after(to_array(share))
    mesh = float(free.start) + share * (collocation.mesh - float(free.start))
    fixed = collocation.with_changes(problem=(problem, problem), mesh=mesh, vary=Rolling.between)
    # The multipliers of rates are of dx over the length of an interval, and those of inequalities densities over the
    # whole duration: neither depends on σ.
    y = fixed.join(
        parts._replace(
            knots=parts.knots[..., :-1],
            nodes=parts.nodes[..., :-1],
            at_start=parts.at_start[:-1],
            at_nodes=parts.at_nodes[..., :-1],
            at_knots=parts.at_knots[..., :-1],
            excess=parts.excess[..., :-2],
        )
    )
    return Solution(fixed, y, 0.0, solution.errors)


def _with_share(states: Float[np.ndarray, "*knots n"], share: float) -> Float[np.ndarray, "*knots n_plus_one"]:
    return np.concatenate([states, np.full((*states.shape[:-1], 1), share)], axis=-1)


# The allowed error of a simulation, in units of the mesh's tolerance.
ALLOWED_SIMULATION_ERROR = 10.0


class ControlFile(NamedTuple):
    """The content of a problem file with a table ``[control]``.

    - ``problem``: the problem to be solved.
    - ``easy``: weights of objectives, by their kinds, from which continuation leads to those given. It is the problem
      with these; None if there are none.
    - ``saves``: the number of save times of the scenario found.
    - ``intervals``: the number of intervals of the first mesh.
    - ``tolerance``: the largest error of an interval, relative; the mesh is refined until none is larger.
    - ``violation``: the largest violation of a constraint that is allowed.
    - ``barrier``: with which the search begins.
    - ``guess``: the initial guess of Newton's method.
    - ``units``: those of the scenario, if it states them.
    - ``free_end_time``: the shortest and the longest end time, which is then found; the end of the scenario, between
      them, is its guess. There is no ``easy`` problem then.
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
            f"Optimal control, {'' if self.ok else 'not '}confirmed: a path in "
            f"{number_of(len(self.solution.errors), 'interval')}",
            f"  its simulation is up to {seen.apart:.2g} radii away, and misses its end by {seen.missed:.2g} radii",
            f"  the least curvature is {self.curvature:.3g}: "
            f"{'a strict minimum' if self.curvature > 0 else 'no strict minimum'}",
            *(f"  {name} is violated by {by:.2g}" for name, by in self.broken.items()),
        ]
        return "\n".join(lines)

    @property
    def ok(self) -> bool:
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
        return solve_from_guess(problem, mesh, 3, file.tolerance, guess, file.barrier, file.free_end_time)

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
