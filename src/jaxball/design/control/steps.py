"""From the solution of an easy problem to that of a hard one, by continuation."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from ..continuation import Branch, follow
from ..errors import DesignError
from .collocation import BARRIER, Collocation
from .path import Path
from .refine import Solution, mesh_errors, solved
from .rolling import Rolling, between

# Steps in the share of the way, from 0 to 1.
FIRST_STEP, LONGEST_STEP = 0.05, 0.2
# A branch that turns may go back past its start and still come to its end, but seldom from far away.
WITHIN = (-0.5, 1.5)

Guess = Callable[[Rolling, Float[np.ndarray, " N_plus_one"], int], Path]


def at_rest(problem: Rolling, mesh: Float[np.ndarray, " N_plus_one"], stages: int = 3) -> Path:
    """The path on which nothing moves.

    **Arguments:**

    - ``problem``: what is to be solved.
    - ``mesh``: times, the start first and the end last, shape (N + 1,).
    - ``stages``: how many nodes of Gauss an interval has.
    """
    initial = np.asarray(problem.initial)
    shape = (len(mesh) - 1, stages)
    return Path(
        mesh,
        np.tile(initial, (len(mesh), 1)),
        np.tile(initial, (*shape, 1)),
        np.zeros((*shape, problem.controls)),
    )


def started(
    problem: Rolling,
    mesh: Float[np.ndarray, " N_plus_one"],
    stages: int = 3,
    tolerance: float = 1e-6,
    guess: Guess = at_rest,
    barrier: float = BARRIER,
) -> Solution:
    """The solution of a problem to which Newton's method comes from a ``guess``.

    From rest it comes to motions that are small. To others it may come from :func:`rolling_along` the wanted path. What
    the ``barrier`` keeps away from constraints :func:`sharpened` lets come to them.

    **Arguments:**

    - ``problem``: what is to be solved.
    - ``mesh``: times, the start first and the end last, shape (N + 1,).
    - ``stages``: how many nodes of Gauss an interval has.
    - ``tolerance``: the largest error of an interval of the mesh.

    **Raises:** :class:`~jaxball.design.DesignError` where it does not come to one.
    """
    collocation = Collocation((problem, problem), mesh, stages, between, barrier)
    return solved(collocation, guess(problem, mesh, stages), 0.0, tolerance)


def continued(
    solution: Solution,
    problem: Rolling,
    tolerance: float = 1e-6,
    visit: Callable[[Solution], None] = lambda solution: None,
) -> tuple[Branch, Solution]:
    """The solution of ``problem`` at the end of the branch that begins with ``solution``, on a fine enough mesh.

    With constraints it is :func:`sharpened` that makes the mesh finer, after the barrier has fallen.

    The parameter of the branch is the share of the way from one problem to the other, as :func:`between` has it.

    **Arguments:**

    - ``tolerance``: the largest error of an interval of the mesh.
    - ``visit``: is given each solution on the way.

    **Raises:** :class:`~jaxball.design.DesignError` where the branch does not get to its end, or where Newton's method
    finds no solution on a finer mesh.
    """
    before = solution.collocation
    collocation = Collocation((solution.problem, problem), before.mesh, before.stages, between, before.barrier)
    knots = np.ravel(collocation.places.knots)
    weights = np.zeros(collocation.size)
    weights[knots] = 1 / knots.size
    branch = follow(
        collocation,
        solution.y,
        0.0,
        1.0,
        step=FIRST_STEP,
        longest=LONGEST_STEP,
        within=WITHIN,
        weights=weights,
        visit=lambda y, share: visit(Solution(collocation, y, share, np.zeros(0))),
    )
    last = Solution(collocation, branch.y[-1], float(branch.parameter[-1]), np.zeros(0))
    if branch.ended != "end":
        raise DesignError(
            f"The branch must lead to the problem, but it ends after {last.parameter:.3g} of the way "
            f"({branch.ended}, with {len(branch.folds)} turning points); go there in smaller steps, on a finer mesh, "
            "or by another way."
        )
    errors = mesh_errors(collocation, last.y, 1.0)
    if np.max(errors) <= tolerance or collocation.inequalities:
        return branch, last._replace(errors=errors)
    return branch, solved(collocation, last.path, 1.0, tolerance)
