"""Unknowns of collocation from a path on any mesh, Newton's method from there, errors of intervals, and finer meshes.

Errors of a path in the differential equation reduced by finer meshes: Betts, Practical Methods for Optimal Control and
Estimation Using Nonlinear Programming, section 4.7.
"""

import math

import numpy as np
import scipy.sparse
from jaxtyping import Float

from ....simulation.solvers.tableau import gauss
from ..continuation import newton, solver
from ..problem.space import DesignError
from .collocation import SHARP, Collocation, Unknowns
from .problem import Path

MOST_PIECES = 4
# Keeps the equations for the multipliers regular where constraints are redundant.
REGULARISATION = 1e-12


def path_of(collocation: Collocation, y: Float[np.ndarray, " size"]) -> Path:
    """Returns the states and controls of y."""
    return Path(collocation.mesh, *collocation.parts(y)[:3])


def margins(
    collocation: Collocation, path: Path, times: Float[np.ndarray, " k"], parameter: float
) -> Float[np.ndarray, "k i"]:
    """Evaluates the inequalities, at given times of a path."""
    if not collocation.inequalities:
        return np.zeros((len(times), 0))
    return collocation.along(path, "inequalities", times, parameter)


def unknowns_on(collocation: Collocation, path: Path, parameter: float) -> Float[np.ndarray, " size"]:
    """Returns unknowns with the states and controls of a path, on any mesh, and the multipliers that fit them best.

    The multipliers are those with which the gradient of the Lagrangian with respect to states and controls is least;
    the unknowns of inequalities follow from their values on the path, whether it fulfils them or not.
    """
    times = np.ravel(collocation.times)
    shapes = collocation.shapes
    empty = Unknowns(*map(np.zeros, shapes))
    y = collocation.join(
        empty._replace(
            knots=path.states(collocation.mesh),
            nodes=path.states(times).reshape(shapes.nodes),
            controls=path.inputs(times).reshape(shapes.controls),
            # s = slack − multiplier, which is about g where an inequality is far from active.
            excess=margins(collocation, path, times, parameter).reshape(shapes.excess),
        )
    )
    count, equalities = collocation.unconstrained, collocation.equalities
    # Multipliers are still 0 here, so that this is the gradient of the cost and the barrier alone.
    gradient = collocation.residual(y, parameter)[:count]
    A = collocation.jacobian(y, parameter)[0].tocsr()[equalities, :count]
    # Least squares for the multipliers, as a sparse system in place of normal equations, whose condition would be
    # squared.
    matrix = scipy.sparse.block_array(
        [[scipy.sparse.eye_array(count), A.T], [A, -REGULARISATION * scipy.sparse.eye_array(A.shape[0])]]
    )
    order = collocation.order[collocation.order < equalities.stop]
    y[equalities] = solver(matrix, order)(np.append(-gradient, np.zeros(A.shape[0])))[count:]
    return y


def newton_from(
    collocation: Collocation, path: Path, parameter: float
) -> tuple[Collocation, Float[np.ndarray, " size"]]:
    """Finds the solution to which Newton's method converges from a path, with a smaller barrier if necessary.

    A path that fulfils its constraints nearly everywhere, and touches them, is far from the solution for a large
    barrier.

    **Raises:** :class:`~jaxball.studies.design.DesignError` where it does not converge.
    """
    while True:
        try:
            return collocation, newton(collocation, unknowns_on(collocation, path, parameter), parameter)
        except DesignError:
            if not collocation.inequalities or collocation.barrier <= SHARP:
                raise
        collocation = collocation.with_changes(barrier=max(SHARP, collocation.barrier / 10))


def mesh_errors(collocation: Collocation, y: Float[np.ndarray, " size"], parameter: float) -> Float[np.ndarray, " N"]:
    """Computes, for each interval, the largest ∫ |ẋ − rate(t, x, u)| dt of a component of the state, over 1 + max |x|.

    ``collocation``, ``y`` and ``parameter`` are as in a :class:`Solution`.
    """
    # Two more nodes than the method has: at its own, the equations hold and show no error.
    path, quadrature, h = path_of(collocation, y), gauss(collocation.stages + 2), collocation.steps
    times = np.ravel(collocation.mesh[:-1, None] + h[:, None] * quadrature.c)
    states = path.states(times)
    rates = collocation.along(path, "rate", times, parameter)
    # Relative to the largest value of each component, so that components of any unit compare.
    gaps = np.abs(path.rates(times) - rates) / (1 + np.max(np.abs(states), axis=0))
    gaps = gaps.reshape(len(h), len(quadrature.c), -1)
    return np.max(np.einsum("k,j,kjn->kn", h, quadrature.b, gaps), axis=1)


def finer_mesh(
    mesh: Float[np.ndarray, " N_plus_one"], errors: Float[np.ndarray, " N"], tolerance: float, order: int
) -> Float[np.ndarray, " M_plus_one"]:
    """Returns the mesh with each interval whose error is too large cut in equal pieces, as many as the order requires.

    **Arguments:**

    - ``mesh``: times, the start first and the end last, shape (N + 1,).
    - ``errors``: of each interval, shape (N,).
    - ``tolerance``: the largest error allowed.
    - ``order``: of the method.
    """
    pieces = [
        # The error of an interval falls with this power of its length.
        min(MOST_PIECES, max(2, math.ceil((error / tolerance) ** (1 / order)))) if error > tolerance else 1
        for error in errors
    ]
    cut = [np.linspace(a, b, k, endpoint=False) for a, b, k in zip(mesh[:-1], mesh[1:], pieces, strict=True)]
    return np.concatenate([*cut, mesh[-1:]])
