"""From a solution with a large barrier, which keeps away from its inequalities, to one that may touch them."""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from ..equations import newton
from ..errors import DesignError
from .collocation import SHARP, Collocation
from .inequalities import violations
from .refine import Solution, finer_mesh, mesh_errors, near

# By how much an inequality may be violated between the nodes.
VIOLATION = 1e-4
# The barrier with which a solution is begun on a finer mesh, and by what it is multiplied: at first, and where it can
# fall no further.
AGAIN, STEP, SHORTEST_STEP = 1e-4, 0.1, 0.95
MOST_ROUNDS = 12


def sharpened(
    solution: Solution,
    barrier: float = SHARP,
    tolerance: float = 1e-6,
    violation: float = VIOLATION,
    visit: Callable[[Solution], None] = lambda solution: None,
) -> Solution:
    """The solution with a small barrier, on meshes finer until its inequalities hold between the nodes as well.

    Where Newton's method finds none on a finer mesh, it is the last one found, whose errors and violations tell.

    The barrier falls in steps, each solved by Newton's method from the solution before. In a convex problem the cost is
    then above the least by at most µ for each inequality (Boyd & Vandenberghe, Convex Optimization, section 11.2.2).

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    - ``barrier``: µ at the end.
    - ``tolerance``: of :func:`mesh_errors`; ``violation``: of :func:`violations`.
    - ``visit``: called with the solution on each mesh.

    **Raises:** :class:`~jaxball.design.DesignError` where the barrier cannot fall.
    """
    collocation, y, parameter, sharp = solution.collocation, solution.y, solution.parameter, solution
    if not collocation.inequalities:
        return solution
    for _ in range(MOST_ROUNDS):
        try:
            collocation, y = _lowered(collocation, y, parameter, barrier)
        except DesignError:
            if sharp is solution:
                raise
            break
        errors = mesh_errors(collocation, y, parameter)
        sharp = Solution(collocation, y, parameter, errors)
        visit(sharp)
        excess = np.maximum(errors / tolerance, violations(collocation, sharp.path, parameter) / violation)
        if np.max(excess) <= 1:
            break
        finer = finer_mesh(collocation.mesh, excess, 1.0, collocation.stages + 1)
        try:
            collocation, y = near(collocation.changed(finer, max(barrier, AGAIN)), sharp.path, parameter)
        except DesignError:
            break
    return sharp


def _lowered(
    collocation: Collocation, y: Float[np.ndarray, " size"], parameter: float, barrier: float
) -> tuple[Collocation, Float[np.ndarray, " size"]]:
    """The solution with a smaller barrier, by steps that become shorter where Newton's method fails."""
    step = STEP
    while collocation.barrier > barrier:
        lower = collocation.changed(barrier=max(barrier, step * collocation.barrier))
        try:
            y = newton(lower, y, parameter)
        except DesignError:
            step = math.sqrt(step)
            if step > SHORTEST_STEP:
                raise DesignError(
                    f"The barrier must fall to {barrier:g}, but below {collocation.barrier:.2g} Newton's method finds "
                    "no solution; look whether the inequalities leave one, or begin with more intervals or a smaller "
                    "barrier."
                ) from None
            continue
        collocation = lower
    return collocation, y
