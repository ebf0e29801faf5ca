"""Minimisation from many starts side by side, on arrays of NumPy: Adam, BFGS, and Newton's method.

All starts are evaluated together, by one compiled program, which is called again and again: a solve inside a compiled
loop of a minimiser takes much longer to compile.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

FIRST, SECOND, TINY = 0.9, 0.999, 1e-8


class Adam(NamedTuple):
    """Adam (Kingma & Ba, ICLR 2015, algorithm 1), whose state can be written to a file.

    It is the running means of gradients and of their squares, and how many there were.
    """

    first: Float[np.ndarray, "starts n"]
    second: Float[np.ndarray, "starts n"]
    taken: np.ndarray

    @staticmethod
    def none(shape: tuple[int, ...]) -> "Adam":
        """Before the first gradient."""
        return Adam(np.zeros(shape), np.zeros(shape), np.asarray(0))

    def after(self, gradient: Float[np.ndarray, "starts n"]) -> "Adam":
        """With one gradient more."""
        first = FIRST * self.first + (1 - FIRST) * gradient
        return Adam(first, SECOND * self.second + (1 - SECOND) * gradient**2, self.taken + 1)

    def step(self, rate: float) -> Float[np.ndarray, "starts n"]:
        """The step to take."""
        first = self.first / (1 - FIRST**self.taken)
        return -rate * first / (np.sqrt(self.second / (1 - SECOND**self.taken)) + TINY)


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


def bfgs(function: Function, y: Float[np.ndarray, "starts n"], evaluations: int, stationary: float) -> Point:
    """The point that BFGS reached from each start within so many evaluations, by steps of the weak Wolfe conditions.

    It ends where no entry of the gradient is larger than ``stationary``. A trial at which the function is not finite
    counts as too long a step. The bisection of Lewis & Overton (Nonsmooth optimization via quasi-Newton methods, Math.
    Program. 141 (2013) 135, algorithm 2.6) does not need smoothness, which the least of many distances lacks.
    """
    starts, n = y.shape
    at = Point(y, *function(y)[:2])
    inverse = np.broadcast_to(np.eye(n), (starts, n, n)).copy()
    fresh = np.ones(starts, dtype=bool)
    direction = _towards(at, inverse)
    length = _first(at, direction)
    low, high = np.zeros(starts), np.full(starts, np.inf)
    for _ in range(evaluations):
        converged = np.max(np.abs(at.gradient), axis=1) <= stationary
        if np.all(converged | ~np.isfinite(at.value)):
            break
        trial = at.y + np.where(converged, 0.0, length)[:, None] * direction
        there = Point(trial, *function(trial)[:2])
        slope = np.sum(at.gradient * direction, axis=1)
        finite = np.isfinite(there.value) & np.all(np.isfinite(there.gradient), axis=1)
        enough = finite & (there.value <= at.value + DECREASE * length * slope)
        flat = enough & (np.sum(there.gradient * direction, axis=1) >= CURVATURE * slope)
        # Where bisection has reached rounding, any step that decreases the function is taken.
        stuck = (high - low < 1e-10 * np.maximum(high, 1e-10)) | (length > 1e6)
        taken = ~converged & (flat | (enough & stuck))
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


DAMPING, LESS, MORE = 1e-3, 0.2, 4.0
ENOUGH, GOOD = 1e-4, 0.5
# A step with a predicted decrease below this fraction of the function is the last: the rest is within the errors of
# solves.
LAST = 1e-10


def newton(function: Function, y: Float[np.ndarray, "starts n"], evaluations: int, stationary: float) -> Point:
    """The point that Newton's method reached from each start within so many evaluations.

    It is damped after Levenberg and Marquardt. For a Hessian that is not positive definite, the absolute values of the
    eigenvalues are used, so that every step is a descent (Nocedal & Wright, Numerical Optimization, section 3.4).
    ``function`` returns values, gradients, and Hessians or approximations; otherwise as for :func:`bfgs`.
    """
    at, H = _evaluated(function, y)
    damping, done = np.full(len(y), DAMPING), np.zeros(len(y), dtype=bool)
    for _ in range(evaluations):
        done |= (np.max(np.abs(at.gradient), axis=1) <= stationary) | ~np.isfinite(at.value)
        if np.all(done):
            break
        step, promised = _step(at, H, damping)
        last = promised <= LAST * np.abs(at.value)
        there, H_there = _evaluated(function, at.y + np.where(done[:, None], 0.0, step))
        gain = (at.value - there.value) / np.where(promised > 0, promised, 1.0)
        taken = ~done & (gain >= ENOUGH) & np.all(np.isfinite(there.gradient), axis=1)
        damping = np.where(taken, np.where(gain >= GOOD, LESS, 1.0), MORE) * damping
        at, H = there.where(taken, at), np.where(taken[:, None, None], H_there, H)
        done |= last
    return at


def _evaluated(function: Function, y: np.ndarray) -> tuple[Point, np.ndarray]:
    value, gradient, H = function(y)
    return Point(y, value, gradient), H


def _step(at: Point, H: np.ndarray, damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The step, with each eigenvalue raised by this fraction of the largest, and its predicted decrease."""
    known = np.isfinite(at.value) & np.all(np.isfinite(H), axis=(1, 2))
    values, vectors = np.linalg.eigh(np.where(known[:, None, None], H, np.eye(H.shape[1])))
    size = np.abs(values)
    along = np.einsum("sij,si->sj", vectors, np.where(np.isfinite(at.gradient), at.gradient, 0.0))
    moved = along / np.maximum(size + damping[:, None] * np.max(size, axis=1, keepdims=True), 1e-300)
    return -np.einsum("sij,sj->si", vectors, moved), np.sum(moved * (along - size * moved / 2), axis=1)
