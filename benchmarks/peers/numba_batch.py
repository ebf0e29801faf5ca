"""Perturbed copies of the paper's ball in numbalsoda's DOP853, on all cores by Numba's ``prange``."""

import numba
import numpy as np
from comparison.contenders import MAX_STEPS_OF_BENCH
from comparison.contenders.numbalsoda_ import Legs, advance, right_hand_side
from comparison.problems.rolling import BALL
from perturbed import states
from turns import Compiled


class Batch(Compiled):
    """All rows in one call."""

    def __init__(self, q: np.ndarray, Omega: np.ndarray, cores: int):
        numba.set_num_threads(cores)
        one, self.x, self.legs, self.rates = advance("DOP853"), states(q, Omega), Legs.of(BALL), right_hand_side(BALL)

        @numba.njit(parallel=True)
        def run_all(address, x, ends, data, tolerance):
            found = np.empty_like(x)
            for i in numba.prange(x.shape[0]):
                # A copy, because the evaluations are counted in it.
                found[i] = one(address, x[i], ends, data.copy(), tolerance, tolerance, MAX_STEPS_OF_BENCH)[0]
            return found

        self.run_all = run_all

    def final(self, tolerance: float) -> np.ndarray:
        return self.run_all(self.rates.address, self.x, *self.legs, tolerance)[:, -9:]
