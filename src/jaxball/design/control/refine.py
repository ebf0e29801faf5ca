"""The errors of a path in the differential equation, and finer meshes that reduce them.

Betts, Practical Methods for Optimal Control and Estimation Using Nonlinear Programming, section 4.7.
"""

import math

import numpy as np
import scipy.sparse
from jaxtyping import Float

from ...solvers.tableau import gauss
from ..equations import newton, solver
from ..problem.variables import DesignError
from .collocation import SHARP, Collocation, Unknowns
from .path import Path
from .solution import Solution, margins, path_of

MOST_PIECES = 4
MOST_ROUNDS = 8
# Keeps the equations for the multipliers regular where constraints are redundant.
SMALL = 1e-12


def unknowns_on(collocation: Collocation, path: Path, parameter: float) -> Float[np.ndarray, " size"]:
    """Unknowns with the states and controls of a path, on any mesh, and the multipliers that fit them best.

    The multipliers are those with which the gradient of the Lagrangian with respect to states and controls is least;
    the unknowns of inequalities follow from their values on the path, whether it fulfils them or not.
    """
    times = np.ravel(collocation.times)
    shapes = collocation.shapes
    empty = Unknowns(*map(np.zeros, shapes))
    y = collocation.joined(
        empty._replace(
            knots=path.states(collocation.mesh),
            nodes=path.states(times).reshape(shapes.nodes),
            controls=path.inputs(times).reshape(shapes.controls),
            excess=margins(collocation, path, times, parameter).reshape(shapes.excess),
        )
    )
    count, equalities = collocation.unconstrained, collocation.equalities
    gradient = collocation.residual(y, parameter)[:count]
    A = collocation.jacobian(y, parameter)[0].tocsr()[equalities, :count]
    matrix = scipy.sparse.block_array(
        [[scipy.sparse.eye_array(count), A.T], [A, -SMALL * scipy.sparse.eye_array(A.shape[0])]]
    )
    y[equalities] = solver(matrix.tocsc())(np.append(-gradient, np.zeros(A.shape[0])))[count:]
    return y


def solved(collocation: Collocation, path: Path, parameter: float = 0.0, tolerance: float = 1e-6) -> Solution:
    """The solution near a path, on meshes refined until no interval's error exceeds ``tolerance``.

    **Arguments:**

    - ``collocation``: the equations on the first mesh.
    - ``path``: where Newton's method starts.
    - ``parameter``: λ.

    **Raises:** :class:`~jaxball.design.DesignError` where Newton's method finds no solution.
    """
    rounds = 0
    while True:
        collocation, y = near(collocation, path, parameter)
        errors = mesh_errors(collocation, y, parameter)
        if np.max(errors) <= tolerance or rounds == MOST_ROUNDS:
            return Solution(collocation, y, parameter, errors)
        path, rounds = path_of(collocation, y), rounds + 1
        finer = finer_mesh(collocation.mesh, errors, tolerance, collocation.stages + 1)
        collocation = collocation.changed(mesh=finer)


def near(collocation: Collocation, path: Path, parameter: float) -> tuple[Collocation, Float[np.ndarray, " size"]]:
    """The solution to which Newton's method converges from a path, with a smaller barrier if necessary.

    A path that fulfils its constraints nearly everywhere, and touches them, is far from the solution for a large
    barrier.

    **Raises:** :class:`~jaxball.design.DesignError` where it does not converge.
    """
    while True:
        try:
            return collocation, newton(collocation, unknowns_on(collocation, path, parameter), parameter)
        except DesignError:
            if not collocation.inequalities or collocation.barrier <= SHARP:
                raise
        collocation = collocation.changed(barrier=max(SHARP, collocation.barrier / 10))


def mesh_errors(collocation: Collocation, y: Float[np.ndarray, " size"], parameter: float) -> Float[np.ndarray, " N"]:
    """For each interval, the largest ∫ |ẋ − rate(t, x, u)| dt of a component of the state, over 1 + max |x|.

    **Arguments:**

    - ``collocation``, ``y``, ``parameter``: as in a :class:`Solution`.
    """
    path, quadrature, h = path_of(collocation, y), gauss(collocation.stages + 2), collocation.steps
    times = np.ravel(collocation.mesh[:-1, None] + h[:, None] * quadrature.c)
    states = path.states(times)
    rates = collocation.along(path, "rate", times, parameter)
    gaps = np.abs(path.rates(times) - rates) / (1 + np.max(np.abs(states), axis=0))
    gaps = gaps.reshape(len(h), len(quadrature.c), -1)
    return np.max(np.einsum("k,j,kjn->kn", h, quadrature.b, gaps), axis=1)


def finer_mesh(
    mesh: Float[np.ndarray, " N_plus_one"], errors: Float[np.ndarray, " N"], tolerance: float, order: int
) -> Float[np.ndarray, " M_plus_one"]:
    """The mesh with each interval whose error is too large cut in equal pieces, as many as the order requires.

    **Arguments:**

    - ``mesh``: times, the start first and the end last, shape (N + 1,).
    - ``errors``: of each interval, shape (N,).
    - ``tolerance``: the largest error allowed.
    - ``order``: of the method.
    """
    pieces = [
        min(MOST_PIECES, max(2, math.ceil((error / tolerance) ** (1 / order)))) if error > tolerance else 1
        for error in errors
    ]
    cut = [np.linspace(a, b, k, endpoint=False) for a, b, k in zip(mesh[:-1], mesh[1:], pieces, strict=True)]
    return np.concatenate([*cut, mesh[-1:]])
