"""A solution of an optimal control problem, and its violations, means of the objectives, and curvature."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.sparse
from jaxtyping import Float, Int

from ..equations import solver
from .collocation import Collocation
from .path import Path
from .problem import AbstractControlProblem
from .rolling import rolling

# The number of points, including both ends, at which inequalities are evaluated in each interval.
PLACES = 11


class Solution(NamedTuple):
    """A solved problem.

    - ``collocation``, ``y``, ``parameter``: the equations, their solution and λ.
    - ``errors``: those of :func:`mesh_errors`.
    """

    collocation: Collocation
    y: Float[np.ndarray, " size"]
    parameter: float
    errors: Float[np.ndarray, " N"]

    @property
    def path(self) -> Path:
        """States and controls."""
        return path_of(self.collocation, self.y)

    @property
    def problem(self) -> AbstractControlProblem:
        """The problem at λ."""
        return self.collocation.vary(self.collocation.problem, jnp.asarray(self.parameter))


def path_of(collocation: Collocation, y: Float[np.ndarray, " size"]) -> Path:
    """The states and controls of y."""
    return Path(collocation.mesh, *collocation.parts(y)[:3])


def margins(
    collocation: Collocation, path: Path, times: Float[np.ndarray, " k"], parameter: float
) -> Float[np.ndarray, "k i"]:
    """The inequalities, at given times of a path."""
    if not collocation.inequalities:
        return np.zeros((len(times), 0))
    return collocation.along(path, "inequalities", times, parameter)


def violations(collocation: Collocation, path: Path, parameter: float) -> Float[np.ndarray, " N"]:
    """The largest violation of an inequality in each interval, between the nodes too; 0 where all hold.

    **Arguments:**

    - ``collocation``, ``path``, ``parameter``: the equations, states and controls, and λ.
    """
    times = path.within(PLACES)
    values = margins(collocation, path, np.ravel(times), parameter)
    return np.max(-values.reshape(*times.shape, collocation.inequalities), axis=(1, 2), initial=0.0)


def means(solution: Solution) -> dict[str, float]:
    """The mean of each objective's integrand over the run, by the weights of Gauss, without its weight.

    **Arguments:**

    - ``solution``: a :class:`Solution` of a :class:`Rolling`.
    """
    rolling(solution.problem)
    collocation = solution.collocation
    terms = collocation.along(solution.path, "terms", np.ravel(collocation.times), solution.parameter)
    return {name: float(np.ravel(collocation.weights) @ values) for name, values in terms.items()}


def least_curvature(solution: Solution) -> float:
    """The smallest eigenvalue of the Lagrangian's second derivative along controls that keep all conditions.

    Inequalities count with the curvature of their barrier. Where the barrier is small, only changes along active
    constraints matter, because changes across them are costly.

    Controls have the norm (1/T ∫ |u|² dt)^½, so that it does not depend on the mesh: where the cost is w |u|² only, it
    is 2 w. A solution with a positive curvature is a strict local minimum.

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
    # Changes of the states for each control.
    change = -solver(A[:, states].tocsc())(A[:, controls].toarray())
    basis = scipy.linalg.null_space(matrix[places.at_end][:, states] @ change)
    along = np.zeros((count, basis.shape[1]))
    along[states], along[controls] = change @ basis, basis
    hessian = along.T @ (_condensed(matrix, np.ravel(places.excess), count) @ along)
    weights = np.repeat(np.ravel(collocation.weights), places.controls.shape[2])
    metric = basis.T @ (weights[:, None] * basis)
    return float(scipy.linalg.eigh(hessian, metric, eigvals_only=True, subset_by_index=(0, 0))[0])


def _condensed(matrix: scipy.sparse.csr_array, excess: Int[np.ndarray, " i"], count: int) -> scipy.sparse.csr_array:
    """The second derivatives by states and controls, those by the inequalities' unknowns eliminated."""
    inverse = scipy.sparse.diags_array(1 / matrix[excess][:, excess].diagonal())
    return matrix[:count, :count] - matrix[:count][:, excess] @ inverse @ matrix[excess][:, :count]
