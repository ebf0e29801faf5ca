"""Perturbed copies of the paper's ball in numbalsoda's DOP853, on all cores by Numba's ``prange``."""

import numba
import numpy as np
from perturbed import states
from turns import Compiled

from .numba_ball import run


@numba.njit(parallel=True)
def run_all(x, tolerance):
    """x(20) of each row."""
    found = np.empty_like(x)
    for i in numba.prange(x.shape[0]):
        found[i] = run(x[i], tolerance)
    return found


class Batch(Compiled):
    """All rows in one call."""

    def __init__(self, q: np.ndarray, Omega: np.ndarray, cores: int):
        numba.set_num_threads(cores)
        self.x = states(q, Omega)

    def final(self, tolerance: float) -> np.ndarray:
        return run_all(self.x, tolerance)[:, -9:]
