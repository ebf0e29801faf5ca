"""Whether a solution of the conditions of Karush, Kuhn and Tucker is a minimum."""

import numpy as np
import scipy.linalg
import scipy.sparse
from jaxtyping import Int

from ..equations import solver
from .refine import Solution


def least_curvature(solution: Solution) -> float:
    """The least eigenvalue of the Lagrangian's second derivative along controls that keep all conditions.

    Inequalities count with the curvature of their barrier. Where the barrier is small, it is that of changes along the
    boundaries that are touched, because changes across them cost much.

    Controls have the norm (1/T ∫ |u|² dt)^½, so that it does not depend on the mesh: where the cost is w |u|² and
    nothing else, it is 2 w. A solution with a positive one is a strict local minimum.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    """
    collocation = solution.collocation
    places, count = collocation.places, collocation.unconstrained
    matrix = collocation.jacobian(solution.y, solution.parameter)[0].tocsr()
    states = np.concatenate([np.ravel(places.knots), np.ravel(places.nodes)])
    controls = np.ravel(places.controls)
    equations = np.concatenate([np.ravel(part) for part in (places.at_start, places.at_nodes, places.at_knots)])
    A = matrix[equations]
    # Changes of the states that go with each control.
    change = -solver(A[:, states].tocsc())(A[:, controls].toarray())
    basis = scipy.linalg.null_space(matrix[places.at_end][:, states] @ change)
    weights = collocation.steps[:, None] * collocation.tableau.b / np.sum(collocation.steps)
    weights = np.repeat(np.ravel(weights), places.controls.shape[2])
    along = np.zeros((count, basis.shape[1]))
    along[states], along[controls] = change @ basis, basis
    hessian = along.T @ (_condensed(matrix, np.ravel(places.excess), count) @ along)
    metric = basis.T @ (weights[:, None] * basis)
    return float(scipy.linalg.eigh(hessian, metric, eigvals_only=True, subset_by_index=(0, 0))[0])


def _condensed(matrix: scipy.sparse.csr_array, excess: Int[np.ndarray, " i"], count: int) -> scipy.sparse.csr_array:
    """The second derivatives by states and controls, those by the inequalities' unknowns eliminated."""
    inverse = scipy.sparse.diags_array(1 / matrix[excess][:, excess].diagonal())
    return matrix[:count, :count] - matrix[:count][:, excess] @ inverse @ matrix[excess][:, :count]
