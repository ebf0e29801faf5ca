"""Solves a problem of optimal control: from a guess, by continuation in weights, and in the barrier."""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from ..continuation import CORRECTION_TOLERANCE, Branch, follow, newton
from ..problem.space import DesignError
from .collocation import BARRIER, SHARP, Collocation
from .guess import driving
from .inputs import MOTOR_LIMITS
from .problem import VIOLATION, AbstractControlProblem, Path
from .rolling import Rolling, between
from .solution import Solution, finer_mesh, mesh_errors, newton_from, solve_near, violations
from .statics import require_holdable

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
    """Returns the path on which nothing moves, with the controls that keep the body as close to rest as possible.

    **Arguments:**

    - ``problem``: what is to be solved.
    - ``mesh``: times, the start first and the end last, shape (N + 1,).
    - ``stages``: how many nodes of Gauss an interval has.
    """
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
    stages: int = 3,
    tolerance: float = 1e-6,
    guess: Guess = at_rest,
    barrier: float = BARRIER,
) -> Solution:
    """Solves by Newton's method from a ``guess``.

    From rest it converges to small motions; for others, start from :func:`rolling_along` the desired path. The
    ``barrier`` keeps the solution away from constraints, until :func:`sharpen` lets it approach them.

    **Arguments:**

    - ``problem``: what is to be solved.
    - ``mesh``: times, the start first and the end last, shape (N + 1,).
    - ``stages``: how many nodes of Gauss an interval has.
    - ``tolerance``: the largest error of an interval of the mesh.

    **Raises:** :class:`~jaxball.design.DesignError` where it does not converge, and before that for an end at which
    the centre of mass cannot be where the robot could rest.
    """
    require_holdable(problem)
    collocation = Collocation((problem, problem), mesh, stages, between, barrier)
    return solve_near(collocation, guess(problem, mesh, stages), 0.0, tolerance)


def continue_to(
    solution: Solution,
    problem: Rolling,
    tolerance: float = 1e-6,
    visit: Callable[[Solution], None] = lambda solution: None,
) -> tuple[Branch, Solution]:
    """Follows the branch from ``solution`` to ``problem``, and solves at its end on a fine enough mesh.

    With constraints, :func:`sharpen` refines the mesh, after the barrier has fallen.

    The parameter of the branch goes from 0 at one problem to 1 at the other, as in :func:`between`.

    **Arguments:**

    - ``tolerance``: the largest error of an interval of the mesh.
    - ``visit``: called with each solution on the way.

    **Raises:** :class:`~jaxball.design.DesignError` where the branch does not reach its end, or where Newton's method
    finds no solution on a finer mesh.
    """
    before = solution.collocation
    collocation = Collocation((solution.problem, problem), before.mesh, before.stages, between, before.barrier)
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
    """Solves with a small barrier, on meshes refined until the inequalities hold between the nodes as well.

    Where Newton's method finds none on a finer mesh, it is the last one found, as its errors and violations show.

    The barrier falls in steps, each solved by Newton's method from the solution before. In a convex problem the cost
    then exceeds the minimum by at most µ for each inequality (Boyd & Vandenberghe, Convex Optimization, section
    11.2.2).

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    - ``barrier``: µ at the end.
    - ``tolerance``: of :func:`mesh_errors`; ``violation``: of :func:`violations`, of which a tenth is allowed where
      motors have limits.
    - ``visit``: called with the solution on each mesh.

    **Raises:** :class:`~jaxball.design.DesignError` where the barrier cannot be lowered.
    """
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
        excess = np.maximum(errors / tolerance, violations(collocation, sharp.path, parameter) / allowed)
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
