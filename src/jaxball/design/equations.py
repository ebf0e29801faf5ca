"""Systems of equations F(y, λ) = 0 with one parameter, and Newton's method for them."""

import abc
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from jaxtyping import Array, Float

from .problem.variables import DesignError

LEAST_SHARE = 1e-4
# Corrections below this that no longer decrease are rounding.
ROUNDING = 1e-7

# A dense NumPy array, or a sparse SciPy array, whose types do not declare what its methods return.
Matrix = Any


class AbstractEquations(abc.ABC):
    """n equations F(y, λ) = 0 for n unknowns y and a parameter λ."""

    @abc.abstractmethod
    def residual(self, y: Float[np.ndarray, " n"], parameter: float) -> Float[np.ndarray, " n"]:
        """F."""

    @abc.abstractmethod
    def jacobian(self, y: Float[np.ndarray, " n"], parameter: float) -> tuple[Matrix, Float[np.ndarray, " n"]]:
        """∂F/∂y, dense or sparse, and ∂F/∂λ."""

    def sizes(self, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The scale of corrections of y: 1 + |y|."""
        return 1 + np.abs(y)

    def length(self, change: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> float:
        """The norm of a correction of y, by which successive corrections are compared."""
        return float(np.linalg.norm(change))


class FunctionEquations(AbstractEquations):
    """The equations function(y, λ) = 0, with dense derivatives by JAX.

    **Arguments:**

    - ``function``: of (y, λ), from shape (n,) to shape (n,).

    **Example:**

    >>> import numpy as np
    >>> from jaxball.design import FunctionEquations
    >>> equations = FunctionEquations(lambda y, parameter: y**2 - parameter)
    >>> equations.jacobian(np.array([3.0]), 9.0)  # 2 y and −1
    (array([[6.]]), array([-1.]))
    """

    def __init__(self, function: Callable[[Float[Array, " n"], Float[Array, ""]], Float[Array, " n"]]):
        self._residual = jax.jit(function)
        self._jacobian = jax.jit(jax.jacfwd(function, argnums=(0, 1)))

    def residual(self, y, parameter):
        return np.asarray(self._residual(jnp.asarray(y), jnp.asarray(parameter)))

    def jacobian(self, y, parameter):
        by_y, by_parameter = self._jacobian(jnp.asarray(y), jnp.asarray(parameter))
        return np.asarray(by_y), np.asarray(by_parameter)


def solver(matrix: Matrix) -> Callable[[np.ndarray], np.ndarray]:
    """A solver for systems with ``matrix``.

    **Raises:** ``numpy.linalg.LinAlgError`` or ``RuntimeError`` where it is singular.
    """
    if isinstance(matrix, np.ndarray):
        return lambda right: np.linalg.solve(matrix, right)
    return scipy.sparse.linalg.splu(matrix.tocsc()).solve


def bordered_solver(
    matrix: Matrix, column: Float[np.ndarray, " n"], row: Float[np.ndarray, " n_plus_one"]
) -> Callable[[np.ndarray], np.ndarray]:
    """A solver for systems with ``matrix``, ``column`` on its right and ``row`` below both.

    **Raises:** as :func:`solver`.
    """
    if isinstance(matrix, np.ndarray):
        return solver(np.vstack([np.column_stack([matrix, column]), row]))
    upper = scipy.sparse.hstack([matrix, scipy.sparse.csr_array(column[:, None])])
    return solver(scipy.sparse.vstack([upper, scipy.sparse.csr_array(row[None])]))


def newton(
    equations: AbstractEquations,
    y: Float[np.ndarray, " n"],
    parameter: float,
    tolerance: float = 1e-10,
    most: int = 50,
) -> Float[np.ndarray, " n"]:
    """A solution near ``y``, by Newton's method with the natural monotonicity test.

    A correction is shortened until the next one, by the same Jacobian, is shorter (Deuflhard, Newton Methods for
    Nonlinear Problems, section 3.3.1), whatever the units of equations and unknowns. It ends when no entry of a
    correction is larger than ``tolerance`` (1 + |y|).

    **Raises:** :class:`~jaxball.design.DesignError` where it does not converge in ``most`` corrections.
    """
    share = 1.0
    for _ in range(most):
        solve = solver(equations.jacobian(y, parameter)[0])
        change = -solve(equations.residual(y, parameter))
        sizes = equations.sizes(y)
        largest, length = np.max(np.abs(change) / sizes), equations.length(change, y)
        if largest <= tolerance:
            return y + change
        share = min(1.0, 2 * share)
        while share > LEAST_SHARE:
            next_change = solve(equations.residual(y + share * change, parameter))
            if equations.length(next_change, y) <= (1 - share / 4) * length:
                break
            share /= 2
        else:
            if largest <= ROUNDING:
                return y
            break
        y = y + share * change
    raise DesignError(
        f"Newton's method must converge at λ = {parameter:g}, but it does not; start from a better guess, or reach "
        "this λ by continuation from one at which the problem is easier. Redundant conditions at the end of a motion "
        "need some `softness`."
    )
