"""Perturbed copies of the paper's ball: the same parameters, other initial q and Ω."""

import numpy as np

SIZE = 1e-2
SEED = 1


def initial(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """q of unit length and Ω of each row: at rest and upright, but for normal deviates of standard deviation 1e-2."""
    random = np.random.default_rng(SEED)
    q = np.array([1.0, 0.0, 0.0, 0.0]) + SIZE * random.normal(size=(rows, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True), SIZE * random.normal(size=(rows, 3))


def states(q: np.ndarray, Omega: np.ndarray) -> np.ndarray:
    """The paper's fifteen numbers (θ, θ̇, q, Ω, z) of each row."""
    from comparison.problems.rolling import BALL

    x = np.tile(BALL.initial, (len(q), 1))
    x[:, -9:-5], x[:, -5:-2] = q, Omega
    return x


def errors(found: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """The largest component of (q, Ω, z) of each row by which it is off; NaN where a solve failed.

    Where one has fewer rows, these are compared.
    """
    known = min(len(found), len(exact))
    return np.max(np.abs(found[:known] - exact[:known]), axis=1)
