"""Newton's method from many starts side by side, damped after Levenberg and Marquardt.

For a Hessian that is not positive definite, the absolute values of the eigenvalues are used, so that every step is a
descent (Nocedal & Wright, Numerical Optimization, section 3.4).
"""

import numpy as np
from jaxtyping import Float

from .bfgs import Function, Point

DAMPING, LESS, MORE = 1e-3, 0.2, 4.0
ENOUGH, GOOD = 1e-4, 0.5
# A step with a predicted decrease below this fraction of the function is the last: the rest is within the errors of
# solves.
LAST = 1e-10


def minimise(function: Function, y: Float[np.ndarray, "starts n"], evaluations: int, stationary: float) -> Point:
    """The point that Newton's method reached from each start within so many evaluations.

    ``function`` returns values, gradients, and Hessians or approximations. It ends where no entry of the
    gradient is larger than ``stationary``. A trial at which the function is not finite counts as too long a step.
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
