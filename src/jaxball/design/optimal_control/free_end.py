"""Optimal control whose end time is found: the time is stretched by a number that belongs to the state.

On a mesh from ``start`` to ``end``, t = start + σ (s − start) is the time at s, and dx/ds = σ rate(t, x, u), dσ/ds = 0
(Betts, Practical Methods for Optimal Control, section 4.10). σ at the start is free, so that its multiplier there
vanishes. With σ found, states, controls and multipliers are those of the problem with the end that it stands for.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.arrays import Numbers, to_array
from ..objectives import FollowTrajectory
from ..problem.requirements import AbstractRunningConstraint
from ..problem.space import DesignError
from .collocation import SHARP, Collocation, as_it_is
from .problem import VIOLATION, AbstractControlProblem
from .rolling import Rolling, between
from .solution import Solution, solve_near
from .solve import Guess, at_rest, sharpen
from .statics import require_holdable

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
        """Raises a :class:`~jaxball.design.DesignError` unless the guess of the ``end`` is between the bounds."""
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


def solve_with_free_end(
    problem: Rolling,
    mesh: Float[np.ndarray, " N_plus_one"],
    free_end_time: tuple[float, float],
    stages: int = 3,
    tolerance: float = 1e-6,
    *,
    time_weight: Numbers = 1.0,
    guess: Guess = at_rest,
    barrier: float = BARRIER_OF_TIME,
    sharp: float = SHARP,
    violation: float = VIOLATION,
) -> Solution:
    """Solves a problem with the end time as another unknown.

    What is least is the mean of the problem's running cost, and ``time_weight`` times the duration over that of
    ``mesh``; without objectives it is the duration alone, which limits of motors or other constraints bound. The
    solution is one of a :class:`Rolling` with the end found, as :func:`solve_from_guess` returns it.

    **Arguments:**

    - ``problem``: what is to be solved; a :class:`~jaxball.design.FollowTrajectory` arrives when the run ends.
    - ``mesh``: times, the start first and a guess of the end last, shape (N + 1,).
    - ``free_end_time``: the shortest and the longest end time.
    - ``stages``, ``tolerance``, ``guess``, ``barrier``: as for :func:`solve_from_guess`.
    - ``time_weight``: of the duration.
    - ``sharp``, ``violation``: ``barrier`` and ``violation`` of :func:`sharpen`.

    **Raises:** :class:`~jaxball.design.DesignError` where it does not converge, for an end at which nothing can rest,
    and unless the guess of the end lies between ``free_end_time``, and these after the start.
    """
    shortest, longest = map(float, free_end_time)
    free = FreeEndTime(shortest, longest, float(np.asarray(time_weight)))
    rough = solve_from_guess_with_free_end(problem, mesh, free, stages, tolerance, guess, barrier)
    return fix_end(sharpen(rough, sharp, tolerance, violation))


def solve_from_guess_with_free_end(
    problem: Rolling,
    mesh: Float[np.ndarray, " N_plus_one"],
    free: FreeEndTime,
    stages: int = 3,
    tolerance: float = 1e-6,
    guess: Guess = at_rest,
    barrier: float = BARRIER_OF_TIME,
) -> Solution:
    """Solves by Newton's method from a ``guess``, far from the bounds of the end time; a solution of
    a :class:`FreeEnd`.

    **Arguments** and errors are those of :func:`solve_with_free_end`; a guess may have σ as the last entry of its
    states.
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
    fixed = Collocation((problem, problem), mesh, collocation.stages, between, collocation.barrier)
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
