"""BFGS from many starts side by side, with steps that fulfil the weak Wolfe conditions.

The bisection of Lewis & Overton (Nonsmooth optimization via quasi-Newton methods, Math. Program. 141 (2013) 135,
algorithm 2.6) does not need smoothness, which the least of many distances lacks. All starts are evaluated together,
by one compiled program, which is called again and again: a solve inside a compiled loop of a minimiser takes much
longer to compile.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

DECREASE, CURVATURE = 1e-4, 0.9
LONGEST = 1.0

# To values, shape (starts,), gradients, (starts, n), and, for Newton's method, Hessians, (starts, n, n).
Function = Callable[[Float[np.ndarray, "starts n"]], tuple[Any, ...]]


class Point(NamedTuple):
    """The unknowns of each start with the function and its gradient there."""

    y: Float[np.ndarray, "starts n"]
    value: Float[np.ndarray, " starts"]
    gradient: Float[np.ndarray, "starts n"]

    def where(self, which: np.ndarray, other: "Point") -> "Point":
        """This point in the starts ``which``, and the other elsewhere."""
        columns = which[:, None]
        return Point(
            np.where(columns, self.y, other.y),
            np.where(which, self.value, other.value),
            np.where(columns, self.gradient, other.gradient),
        )


def minimise(function: Function, y: Float[np.ndarray, "starts n"], evaluations: int, stationary: float) -> Point:
    """The point that BFGS reached from each start within so many evaluations.

    It ends where no entry of the gradient is larger than ``stationary``. A trial at which the function is not finite
    counts as too long a step.
    """
    starts, n = y.shape
    at = Point(y, *function(y)[:2])
    inverse = np.broadcast_to(np.eye(n), (starts, n, n)).copy()
    fresh = np.ones(starts, dtype=bool)
    direction = _towards(at, inverse)
    length = _first(at, direction)
    low, high = np.zeros(starts), np.full(starts, np.inf)
    for _ in range(evaluations):
        settled = np.max(np.abs(at.gradient), axis=1) <= stationary
        if np.all(settled | ~np.isfinite(at.value)):
            break
        trial = at.y + np.where(settled, 0.0, length)[:, None] * direction
        there = Point(trial, *function(trial)[:2])
        slope = np.sum(at.gradient * direction, axis=1)
        finite = np.isfinite(there.value) & np.all(np.isfinite(there.gradient), axis=1)
        enough = finite & (there.value <= at.value + DECREASE * length * slope)
        flat = enough & (np.sum(there.gradient * direction, axis=1) >= CURVATURE * slope)
        # Where bisection has reached rounding, any step that decreases the function is taken.
        stuck = (high - low < 1e-10 * np.maximum(high, 1e-10)) | (length > 1e6)
        taken = ~settled & (flat | (enough & stuck))
        inverse, fresh = _updated(inverse, fresh, at, there, taken)
        high = np.where(enough, high, length)
        low = np.where(enough & ~flat, length, low)
        length = np.where(np.isfinite(high), (low + high) / 2, 2 * length)
        at = there.where(taken, at)
        # A direction without descent is replaced by steepest descent.
        reset = ~taken & stuck & ~fresh
        inverse[reset], fresh[reset] = np.eye(n), True
        begin = taken | reset
        direction = np.where(begin[:, None], _towards(at, inverse), direction)
        length = np.where(taken & ~fresh, 1.0, np.where(begin, _first(at, direction), length))
        low, high = np.where(begin, 0.0, low), np.where(begin, np.inf, high)
    return at


def _towards(at: Point, inverse: np.ndarray) -> np.ndarray:
    return -np.einsum("sij,sj->si", inverse, np.where(np.isfinite(at.gradient), at.gradient, 0.0))


def _first(at: Point, direction: np.ndarray) -> np.ndarray:
    """Lengths of first steps that move y by no more than 0.1, a tenth of its scale."""
    return np.minimum(LONGEST, 0.1 / np.maximum(np.linalg.norm(direction, axis=1), 1e-300))


def _updated(
    inverse: np.ndarray, fresh: np.ndarray, at: Point, there: Point, taken: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The inverse Hessians after the steps ``taken`` (Nocedal & Wright, eq. 6.17), the first scaled by eq. 6.20."""
    s, y = there.y - at.y, there.gradient - at.gradient
    product = np.sum(s * y, axis=1)
    sizes = np.linalg.norm(s, axis=1) * np.linalg.norm(y, axis=1)
    good = taken & (product > 1e-12 * np.where(np.isfinite(sizes), sizes, np.inf))
    for k in np.flatnonzero(good):
        H = inverse[k]
        if fresh[k]:
            H = np.eye(len(H)) * product[k] / (y[k] @ y[k])
        V = np.eye(len(H)) - np.outer(s[k], y[k]) / product[k]
        inverse[k] = V @ H @ V.T + np.outer(s[k], s[k]) / product[k]
    return inverse, fresh & ~good
