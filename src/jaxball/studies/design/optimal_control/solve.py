"""Solves a problem of optimal control: by continuation in weights and in the barrier, with a given or a free end.

An end is found on a mesh from ``start`` to ``end``, where t = start + σ (s − start) is the time at s, and
dx/ds = σ rate(t, x, u), dσ/ds = 0 (Betts, Practical Methods for Optimal Control, section 4.10). σ at the start is free,
so that its multiplier there vanishes. With σ found, states, controls and multipliers are those of the problem with the
end that it stands for.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ....numerics.arrays import Numbers, to_array
from ..continuation import CORRECTION_TOLERANCE, Branch, follow, newton
from ..objectives import FollowTrajectory
from ..problem.requirements import AbstractRunningConstraint
from ..problem.space import DesignError
from .collocation import BARRIER, SHARP, Collocation, as_it_is
from .guess import driving, require_holdable
from .problem import MOTOR_LIMITS, VIOLATION, AbstractControlProblem, Path
from .rolling import Rolling
from .solution import Solution, finer_mesh, mesh_errors, newton_from, solve_near

# Steps in the homotopy parameter, from 0 to 1.
FIRST_HOMOTOPY_STEP, LONGEST_HOMOTOPY_STEP = 0.05, 0.2
# A branch that turns may go back past its start and still reach its end, but seldom from far away.
BRANCH_WITHIN = (-0.5, 1.5)
# The initial barrier on a finer mesh, and its factors: at first, and where it can fall no further.
AGAIN, STEP, SHORTEST_STEP = 1e-4, 0.1, 0.95
MOST_BARRIERS = 12
# By as much violations are smaller where motors have limits, which cut them off in a simulation.
CUT_OFF = 0.1
# A barrier above the last one, except for rounding, is solved for to this accuracy.
NEARLY_LAST, ROUGH = 1 + 1e-9, 1e-3

Guess = Callable[[Rolling, Float[np.ndarray, " N_plus_one"], int], Path]


def at_rest(problem: Rolling, mesh: Float[np.ndarray, " N_plus_one"], stages: int = 3) -> Path:
    initial = np.asarray(problem.initial)
    shape = (len(mesh) - 1, stages)
    u = driving(problem, mesh[:1], initial[None], np.zeros((1, initial.size)))[0]
    return Path(
        mesh,
        np.tile(initial, (len(mesh), 1)),
        np.tile(initial, (*shape, 1)),
        np.tile(u, (*shape, 1)),
    )


def solve_from_guess(
    problem: Rolling,
    mesh: Float[np.ndarray, " N_plus_one"],
    stages: int,
    tolerance: float,
    guess: Guess,
    barrier: float,
) -> Solution:
    """Solves with the given end time, as :meth:`Rolling.solve` does, from the path that ``guess`` makes."""
    require_holdable(problem)
    collocation = Collocation((problem, problem), mesh, stages, Rolling.between, barrier)
    return solve_near(collocation, guess(problem, mesh, stages), 0.0, tolerance)


def continue_to(
    solution: Solution,
    problem: Rolling,
    tolerance: float = 1e-6,
    visit: Callable[[Solution], None] = lambda solution: None,
) -> tuple[Branch, Solution]:
    before = solution.collocation
    collocation = Collocation((solution.problem, problem), before.mesh, before.stages, Rolling.between, before.barrier)
    # The length of the branch is measured in the mean of the states, so that steps do not depend on the number of
    # intervals; multipliers have no part in it.
    knots = np.ravel(collocation.places.knots)
    weights = np.zeros(collocation.size)
    weights[knots] = 1 / knots.size
    branch = follow(
        collocation,
        solution.y,
        0.0,
        1.0,
        step=FIRST_HOMOTOPY_STEP,
        longest=LONGEST_HOMOTOPY_STEP,
        within=BRANCH_WITHIN,
        weights=weights,
        visit=lambda y, share: visit(Solution(collocation, y, share, np.zeros(0))),
    )
    last = Solution(collocation, branch.y[-1], float(branch.parameter[-1]), np.zeros(0))
    if branch.ended != "end":
        raise DesignError(
            f"The branch must lead to the problem, but it ends after {last.parameter:.3g} of the way ({branch.ended}, "
            f"with {len(branch.folds)} turning points); use smaller steps, a finer mesh, or another path."
        )
    errors = mesh_errors(collocation, last.y, 1.0)
    # With constraints the barrier is still large, and `sharpen` refines the mesh once the solution has come to its
    # place.
    if np.max(errors) <= tolerance or collocation.inequalities:
        return branch, last._replace(errors=errors)
    return branch, solve_near(collocation, last.path, 1.0, tolerance)


def sharpen(
    solution: Solution,
    barrier: float = SHARP,
    tolerance: float = 1e-6,
    violation: float = VIOLATION,
    visit: Callable[[Solution], None] = lambda solution: None,
) -> Solution:
    collocation, y, parameter, sharp = solution.collocation, solution.y, solution.parameter, solution
    if not collocation.inequalities:
        return solution
    allowed = violation * (CUT_OFF if _has_motor_limits(solution.problem) else 1.0)
    for _ in range(MOST_BARRIERS):
        try:
            collocation, y = _lower_barrier(collocation, y, parameter, barrier)
        except DesignError:
            # The first barrier could not fall: nothing sharper than the given solution is known.
            if sharp is solution:
                raise
            break
        errors = mesh_errors(collocation, y, parameter)
        sharp = Solution(collocation, y, parameter, errors)
        visit(sharp)
        # Errors and violations over what is allowed, so that one mesh serves both.
        excess = np.maximum(errors / tolerance, sharp.violations() / allowed)
        if np.max(excess) <= 1:
            break
        finer = finer_mesh(collocation.mesh, excess, 1.0, collocation.stages + 1)
        try:
            collocation, y = newton_from(collocation.with_changes(finer, max(barrier, AGAIN)), sharp.path, parameter)
        except DesignError:
            break
    return sharp


def _has_motor_limits(problem: AbstractControlProblem) -> bool:
    """Returns whether motors of a robot have limits."""
    return MOTOR_LIMITS in getattr(problem, "constraints", {})


def _lower_barrier(
    collocation: Collocation, y: Float[np.ndarray, " size"], parameter: float, barrier: float
) -> tuple[Collocation, Float[np.ndarray, " size"]]:
    """Finds the solution with a smaller barrier, by steps that become shorter where Newton's method fails."""
    step = STEP
    while collocation.barrier > barrier:
        following = step * collocation.barrier
        last = following < NEARLY_LAST * barrier
        lower = collocation.with_changes(barrier=barrier if last else following)
        try:
            y = newton(lower, y, parameter, CORRECTION_TOLERANCE if last else ROUGH)
        except DesignError:
            # A shorter step of the barrier: its factor comes closer to 1.
            step = math.sqrt(step)
            if step > SHORTEST_STEP:
                raise DesignError(
                    f"The barrier must fall to {barrier:g}, but below {collocation.barrier:.2g} Newton's method finds "
                    "no solution; check whether the inequalities leave one, or start with more intervals or a smaller "
                    "barrier."
                ) from None
            continue
        collocation = lower
    return collocation, y


# Of the first solution. Far from the limits of inputs Newton's method converges from rest; the shortest motion, by
# contrast, is at a limit all the time.
BARRIER_OF_TIME = 1.0


class FreeEndTime(NamedTuple):
    """An end time that is to be found.

    - ``shortest``, ``longest``: its bounds.
    - ``weight``: of the duration over that of the first mesh, beside the objectives.
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
        time, stretched = self._stretch(t, x[-1])
        return jnp.append(x[-1] * stretched.rate(time, x[:-1], u), 0.0)

    def cost(self, t, x, u):
        time, stretched = self._stretch(t, x[-1])
        return stretched.cost(time, x[:-1], u) + self.weight * x[-1]

    def inequalities(self, t, x, u):
        time, stretched = self._stretch(t, x[-1])
        bounds = jnp.stack([x[-1] - self.least, self.most - x[-1]])
        return jnp.concatenate([stretched.inequalities(time, x[:-1], u), bounds])

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


def solve_from_guess_with_free_end(
    problem: Rolling,
    mesh: Float[np.ndarray, " N_plus_one"],
    free: FreeEndTime,
    stages: int = 3,
    tolerance: float = 1e-6,
    guess: Guess = at_rest,
    barrier: float = BARRIER_OF_TIME,
) -> Solution:
    """Solves with a free end time, as :meth:`Rolling.solve` does before it lowers the barrier; a solution of
    a :class:`FreeEnd`.

    The path that ``guess`` makes may have σ as the last entry of its states.
    """
    start, end = float(mesh[0]), float(mesh[-1])
    free.check(start, end)
    require_holdable(problem)
    least, most = ((t - start) / (end - start) for t in free[:2])
    timed = eqx.tree_at(lambda p: p.end, problem, to_array(end))
    stretched = FreeEnd(  # pyright: ignore[reportCallIssue]
        problem=timed,
        least=to_array(least),
        most=to_array(most),
        weight=to_array(free.weight),
        start=timed.start,
        end=timed.end,
        softness=timed.softness,
    )
    collocation = Collocation(stretched, mesh, stages, as_it_is, barrier)
    path = guess(timed, mesh, stages)
    if path.knots.shape[-1] == timed.initial.size:
        path = path._replace(knots=_with_share(path.knots, 1.0), nodes=_with_share(path.nodes, 1.0))
    return solve_near(collocation, path, 0.0, tolerance)


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
    fixed = Collocation((problem, problem), mesh, collocation.stages, Rolling.between, collocation.barrier)
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


def solve(
    problem: Rolling,
    mesh: Float[np.ndarray, " N_plus_one"],
    stages: int = 3,
    tolerance: float = 1e-6,
    *,
    guess: Path | None = None,
    barrier: float | None = None,
    free_end_time: tuple[float, float] | None = None,
    time_weight: Numbers = 1.0,
    sharp: float = SHARP,
    violation: float = VIOLATION,
) -> Solution:
    make = at_rest if guess is None else lambda *arguments: guess
    if free_end_time is None:
        return solve_from_guess(problem, mesh, stages, tolerance, make, BARRIER if barrier is None else barrier)
    shortest, longest = map(float, free_end_time)
    free = FreeEndTime(shortest, longest, float(np.asarray(time_weight)))
    first = BARRIER_OF_TIME if barrier is None else barrier
    rough = solve_from_guess_with_free_end(problem, mesh, free, stages, tolerance, make, first)
    return fix_end(sharpen(rough, sharp, tolerance, violation))


def _with_share(states: Float[np.ndarray, "*knots n"], share: float) -> Float[np.ndarray, "*knots n_plus_one"]:
    return np.concatenate([states, np.full((*states.shape[:-1], 1), share)], axis=-1)
