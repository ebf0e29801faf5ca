"""Equations F(y, λ) = 0, Newton's method for them, and their solution branches followed past turning points.

``optimal_control`` solves its equations by it; users may solve their own.

Pseudo-arclength continuation (Keller 1977; Allgower & Georg, Numerical Continuation Methods, chapters 2, 6 and 10): a
predictor along the tangent, and Newton's method on F = 0 together with the condition that the point is at the given
distance along the tangent. The bordered matrix of that system is regular at a fold, where F_y is singular.
"""

import abc
import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from jaxtyping import Array, Float, Int

from ... import programs
from ...numerics.roots import Sample, next_point, other_end
from .problem.space import DesignError

# The numbers of Newton corrections at which a step is neither too short nor too long, and at which it has failed.
EASY, MOST_CORRECTIONS = 4, 8
LONGER, SHORTER = 2.0, 0.5
# The cosine of the largest angle between neighbouring tangents.
STRAIGHT = 0.9
LEAST_STEP = 1e-8
FOLD_SEARCHES, FLAT = 40, 1e-9


# The largest entry of the last correction.
CORRECTION_TOLERANCE = 1e-10
LEAST_SHARE = 1e-4
# Corrections below this that no longer decrease are rounding.
ROUNDING = 1e-7

# A dense NumPy array, or a sparse SciPy array, whose types do not declare what its methods return.
Matrix = Any
Function = Callable[[Float[Array, " n"], Float[Array, ""]], Float[Array, " n"]]


class AbstractEquations(abc.ABC):
    """n equations F(y, λ) = 0 for n unknowns y and a parameter λ."""

    @abc.abstractmethod
    def residual(self, y: Float[np.ndarray, " n"], parameter: float) -> Float[np.ndarray, " n"]:
        """Evaluates F."""

    @abc.abstractmethod
    def jacobian(self, y: Float[np.ndarray, " n"], parameter: float) -> tuple[Matrix, Float[np.ndarray, " n"]]:
        """Returns ∂F/∂y, dense or sparse, and ∂F/∂λ."""

    @functools.cached_property
    def order(self) -> Int[np.ndarray, " n"] | None:
        """An order of equations and unknowns in which a sparse Jacobian has a narrow band; None if none is known."""
        return None

    def sizes(self, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Returns the scale of corrections of y: 1 + |y|."""
        return 1 + np.abs(y)

    def length(self, change: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> float:
        """Computes the norm of a correction of y, by which successive corrections are compared."""
        return float(np.linalg.norm(change))


class FunctionEquations(AbstractEquations):
    """The equations ``function`` (y, λ) = 0, of shape (n,) like y, with dense derivatives by JAX.

    **Example:**

    >>> import numpy as np
    >>> from jaxball.studies.design.continuation import FunctionEquations
    >>> equations = FunctionEquations(lambda y, parameter: y**2 - parameter)
    >>> equations.jacobian(np.array([3.0]), 9.0)  # 2 y and −1
    (array([[6.]]), array([-1.]))
    """

    def __init__(self, function: Function):
        self._residual = programs.jit(function)
        self._jacobian = programs.jit(jax.jacfwd(function, argnums=(0, 1)))

    def residual(self, y, parameter):
        return np.asarray(self._residual(jnp.asarray(y), jnp.asarray(parameter)))

    def jacobian(self, y, parameter):
        by_y, by_parameter = self._jacobian(jnp.asarray(y), jnp.asarray(parameter))
        return np.asarray(by_y), np.asarray(by_parameter)


def solver(matrix: Matrix, order: Int[np.ndarray, " n"] | None = None) -> Callable[[np.ndarray], np.ndarray]:
    """Returns a solver for systems with ``matrix``, which is factorised once.

    **Arguments:**

    - ``order``: of rows and columns, in which a sparse matrix has a narrow band; without it, one is searched for.

    **Raises:** ``numpy.linalg.LinAlgError`` or ``RuntimeError`` where it is singular.
    """
    if isinstance(matrix, np.ndarray):
        return lambda right: np.linalg.solve(matrix, right)
    if order is None:
        return scipy.sparse.linalg.splu(matrix.tocsc()).solve
    # In the given order there is little fill; the search for another would take longer than the factorisation.
    factors = scipy.sparse.linalg.splu(matrix.tocsr()[order][:, order].tocsc(), permc_spec="NATURAL")
    back = np.argsort(order)
    return lambda right: factors.solve(right[order])[back]


def bordered_solver(
    matrix: Matrix,
    column: Float[np.ndarray, " n"],
    row: Float[np.ndarray, " n_plus_one"],
    order: Int[np.ndarray, " n"] | None = None,
) -> Callable[[np.ndarray], np.ndarray]:
    """Returns a solver for systems with ``matrix``, ``column`` on its right and ``row`` below both; ``order`` belongs
    to ``matrix`` alone.

    **Raises:** as :func:`solver`.
    """
    if isinstance(matrix, np.ndarray):
        return solver(np.vstack([np.column_stack([matrix, column]), row]))
    upper = scipy.sparse.hstack([matrix, scipy.sparse.csr_array(column[:, None])])
    # The border comes last: before the band it would fill the whole matrix.
    last = None if order is None else np.append(order, column.size)
    return solver(scipy.sparse.vstack([upper, scipy.sparse.csr_array(row[None])]), last)


def newton(
    equations: AbstractEquations,
    y: Float[np.ndarray, " n"],
    parameter: float,
    tolerance: float = CORRECTION_TOLERANCE,
    most: int = 50,
) -> Float[np.ndarray, " n"]:
    """Finds a solution near ``y``, by Newton's method with the natural monotonicity test.

    A correction is shortened until the next one, by the same Jacobian, is shorter (Deuflhard, Newton Methods for
    Nonlinear Problems, section 3.3.1), whatever the units of equations and unknowns. It ends when no entry of a
    correction is larger than ``tolerance`` (1 + |y|).

    **Raises:** :class:`~jaxball.studies.design.DesignError` where it does not converge in ``most`` corrections.
    """
    share = 1.0
    for _ in range(most):
        solve = solver(equations.jacobian(y, parameter)[0], equations.order)
        change = -solve(equations.residual(y, parameter))
        sizes = equations.sizes(y)
        largest, length = np.max(np.abs(change) / sizes), equations.length(change, y)
        if largest <= tolerance:
            # The correction is known and makes the solution better still.
            return y + change
        # A step that had to be shortened may be longer the next time.
        share = min(1.0, 2 * share)
        while share > LEAST_SHARE:
            # By the factorised Jacobian: a simplified correction costs a residual only, and does not depend on the
            # units of F.
            next_change = solve(equations.residual(y + share * change, parameter))
            if equations.length(next_change, y) <= (1 - share / 4) * length:
                break
            share /= 2
        else:
            # No shortening helped. Where corrections are as small as this, rounding alone prevents the next from
            # being shorter.
            if largest <= ROUNDING:
                return y
            break
        y = y + share * change
    raise DesignError(
        f"Newton's method must converge at λ = {parameter:g}, but it does not; start from a better guess, or reach "
        "this λ by continuation from one at which the problem is easier. Redundant conditions at the end of a motion "
        "need some `softness`."
    )


class Fold(NamedTuple):
    """A turning point: dλ/ds = 0, at ``y``, shape (n,), and λ = ``parameter``.

    It lies between the points ``after`` and ``after + 1`` of its branch.
    """

    after: int
    y: Float[np.ndarray, " n"]
    parameter: float


class Branch(NamedTuple):
    """Points of a solution branch, in their order along it.

    - ``y``, ``parameter``: their positions.
    - ``length``: the arclength s up to each, in the norm that :func:`follow` describes.
    - ``slope``: dλ/ds there.
    - ``folds``: the turning points.
    - ``ended``: why it ends: ``"end"`` (λ has reached ``end``), ``"outside"``, ``"length"``, ``"points"``, or
      ``"lost"``, if no further point could be computed.
    """

    y: Float[np.ndarray, "points n"]
    parameter: Float[np.ndarray, " points"]
    length: Float[np.ndarray, " points"]
    slope: Float[np.ndarray, " points"]
    folds: tuple[Fold, ...]
    ended: str


@dataclasses.dataclass(frozen=True)
class _Point:
    """A point of a branch and its tangent, of length one, to which λ is the last entry of both."""

    Y: Float[np.ndarray, " n_plus_one"]
    tangent: Float[np.ndarray, " n_plus_one"]
    length: float
    corrections: int = 0


def follow(
    equations: AbstractEquations | Function,
    y: Float[np.ndarray, " n"],
    start: float,
    end: float | None = None,
    *,
    direction: float = 1.0,
    step: float = 0.1,
    longest: float = math.inf,
    within: tuple[float, float] = (-math.inf, math.inf),
    length: float = math.inf,
    points: int = 500,
    tolerance: float = CORRECTION_TOLERANCE,
    weights: Float[np.ndarray, " n"] | None = None,
    visit: Callable[[Float[np.ndarray, " n"], float], None] = lambda y, parameter: None,
) -> Branch:
    """Follows the branch of F(y, λ) = 0 through a solution near ``y`` at λ = ``start``.

    **Arguments:**

    - ``equations``: F, a function of (y, λ) that returns an array of shape (n,), like y, which JAX differentiates; or
      the equations of a :class:`~jaxball.studies.design.optimal_control.Collocation`.
    - ``end``: the λ at which the branch ends; reached exactly, without a step past it.
    - ``direction``: whether λ first goes up or down; towards ``end`` if that is given.
    - ``step``, ``longest``: the first and the longest step in arclength.
    - ``within``: the least and the largest λ, beyond which the branch ends.
    - ``length``, ``points``: the largest arclength and number of points of the branch.
    - ``tolerance``: of the corrector: the largest entry of its last correction, over 1 + |Y|.
    - ``weights``: w of the norm ds² = Σ w dy² + dλ²; 1/n if not given. Entries may be 0.
    - ``visit``: called with each point.

    **Raises:** :class:`DesignError` where Newton's method finds no solution near ``y``.

    **Example:**

    >>> import numpy as np
    >>> from jaxball.studies.design import follow
    >>> branch = follow(lambda y, parameter: y**2 + parameter - 1.0, np.array([1.0]), start=0.0, end=-3.0)
    >>> branch.ended, branch.y[-1].round(6)
    ('end', array([2.]))
    """
    if not isinstance(equations, AbstractEquations):
        equations = FunctionEquations(equations)
    corrector = _Corrector(equations, np.full(y.size, 1 / y.size) if weights is None else weights, tolerance)
    if end is not None:
        direction = end - start
    position = corrector.first(np.append(y, start), direction)
    visit(position.Y[:-1], position.Y[-1])
    visited, folds, ended = [position], [], ""
    while not ended:
        there, last = corrector.onward(position, step, end)
        if there is None:
            # Nothing was accepted: the same point is left by half the step.
            step *= SHORTER
            ended = "lost" if step < LEAST_STEP else ""
            continue
        if position.tangent[-1] * there.tangent[-1] < 0:
            folds.append(corrector.fold(len(visited) - 1, position, there))
        visited.append(there)
        visit(there.Y[:-1], there.Y[-1])
        # A corrector that converged in fewer corrections than usual allows a longer step, but never more than twice.
        step = min(longest, step * float(np.clip(EASY / max(there.corrections, 1), SHORTER, LONGER)))
        position = there
        reasons = {
            # "end" first: a last point may fulfil other conditions as well.
            "end": last,
            "outside": not within[0] <= position.Y[-1] <= within[1],
            "length": position.length >= length,
            "points": len(visited) >= points,
        }
        ended = next((reason for reason, condition in reasons.items() if condition), "")
    Y = np.stack([point.Y for point in visited])
    lengths = np.asarray([point.length for point in visited])
    slope = np.asarray([point.tangent[-1] for point in visited])
    return Branch(Y[:, :-1], Y[:, -1], lengths, slope, tuple(folds), ended)


class _Corrector:
    """Equations, a norm and a tolerance: the corrector that leads from one point of a branch to the next."""

    def __init__(self, equations: AbstractEquations, weights: Float[np.ndarray, " n"], tolerance: float):
        self.equations, self.tolerance = equations, tolerance
        self.metric = np.append(weights, 1.0)

    def first(self, Y: Float[np.ndarray, " n_plus_one"], direction: float) -> _Point:
        """Finds the solution at the λ of Y, with the tangent along which λ changes in ``direction``."""
        solved = self._correct(Y, self._fix_parameter(Y))
        if solved is None:
            raise DesignError(
                f"Argument `y` must be near a solution at λ = {Y[-1]:g}, but Newton's method finds none; start from a "
                "better guess, or at a λ where the solution is known."
            )
        # Its λ component is positive by the border, so that the sign of `direction` is that of dλ.
        tangent = self._tangent(solved[0], self._fix_parameter(solved[0]))
        return _Point(solved[0], tangent * math.copysign(1.0, direction), 0.0)

    def step(self, at: _Point, step: float) -> _Point | None:
        """Finds the point at distance ``step`` along the tangent; None if Newton's method fails, or the branch bends
        too much.
        """
        # The condition that the correction is orthogonal to the tangent, in the norm of the branch.
        row = self.metric * at.tangent
        solved = self._correct(at.Y + step * at.tangent, row)
        if solved is None:
            return None
        Y, corrections = solved
        # With the old row as border, the new tangent points onward along the branch, also past a fold, where dλ
        # changes sign.
        tangent = self._tangent(Y, row)
        # Across a sharp bend the corrector may have jumped to another branch.
        if not row @ tangent >= STRAIGHT:
            return None
        return _Point(Y, tangent, at.length + step, corrections)

    def onward(self, at: _Point, step: float, end: float | None) -> tuple[_Point | None, bool]:
        """Returns the next point, None if the step is too long; and whether it is the point with λ = ``end``."""
        there = self.step(at, step)
        # Not past the end: λ − end has kept its sign.
        if there is None or end is None or (at.Y[-1] - end) * (there.Y[-1] - end) > 0:
            return there, False
        # The point with λ = end between these two.
        share = (end - at.Y[-1]) / (there.Y[-1] - at.Y[-1])
        guess = at.Y + share * (there.Y - at.Y)
        guess[-1] = end
        solved = self._correct(guess, self._fix_parameter(guess))
        if solved is None:
            return None, True
        length = at.length + share * (there.length - at.length)
        return _Point(solved[0], self._tangent(solved[0], self.metric * at.tangent), length), True

    def fold(self, after: int, at: _Point, there: _Point) -> Fold:
        """Finds where dλ/ds = 0 between two neighbours, by the Illinois method."""
        # The tangent's λ component is continuous along the branch, and changes its sign between the two.
        old, new = Sample(0.0, at.tangent[-1]), Sample(there.length - at.length, there.tangent[-1])
        # If no point between can be computed, the better end stands for the fold.
        nearest = at if abs(old.f) < abs(new.f) else there
        for _ in range(FOLD_SEARCHES):
            step = float(next_point(old, new, np))
            point = self.step(at, step)
            if point is None:
                break
            newest = Sample(step, point.tangent[-1])
            nearest = point if abs(newest.f) < abs(nearest.tangent[-1]) else nearest
            if abs(newest.f) < FLAT:
                break
            old, new = other_end(old, new, newest, np), newest
        return Fold(after, nearest.Y[:-1], float(nearest.Y[-1]))

    def _fix_parameter(self, Y: np.ndarray) -> np.ndarray:
        """Returns the row of the condition that λ is fixed."""
        return np.eye(1, Y.size, Y.size - 1)[0]

    def _correct(self, Y: np.ndarray, row: np.ndarray) -> tuple[np.ndarray, int] | None:
        """Solves F(Y) = 0 with row · Y fixed by Newton's method; returns Y and the number of corrections."""
        largest = math.inf
        for k in range(1, MOST_CORRECTIONS + 1):
            F = self.equations.residual(Y[:-1], float(Y[-1]))
            if not np.all(np.isfinite(F)):
                return None
            try:
                # The last equation is linear and holds for the first Y, so that its residual stays 0.
                change = self._border(Y, row)(np.append(-F, 0.0))
            except (np.linalg.LinAlgError, RuntimeError):
                return None
            Y = Y + change
            if not np.all(np.isfinite(Y)):
                return None
            sizes = np.append(self.equations.sizes(Y[:-1]), 1 + np.abs(Y[-1]))
            before, largest = largest, np.max(np.abs(change) / sizes)
            # Corrections that no longer become half as large have reached rounding.
            if largest <= self.tolerance or before / 2 < largest < ROUNDING:
                return Y, k
        return None

    def _tangent(self, Y: np.ndarray, row: np.ndarray) -> np.ndarray:
        """Computes the tangent of length one, on the side where row · tangent > 0."""
        tangent = self._border(Y, row)(np.eye(1, Y.size, Y.size - 1)[0])
        return tangent / math.sqrt(self.metric @ tangent**2)

    def _border(self, Y: np.ndarray, row: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Makes a solver for systems with F's Jacobian and ``row`` below it."""
        by_y, by_parameter = self.equations.jacobian(Y[:-1], float(Y[-1]))
        return bordered_solver(by_y, by_parameter, row, self.equations.order)
