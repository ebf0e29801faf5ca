"""Points in the unit cube: random ones, Latin hypercubes, and Sobol's sequence."""

import functools
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float, Int

Design = Callable[[Int[np.ndarray, " points"], int, int, int], Float[np.ndarray, "points numbers"]]


def random(indices: Int[np.ndarray, " points"], count: int, dimension: int, seed: int) -> np.ndarray:
    """Independent uniform numbers, computed for each point from its index alone by a counter-based generator."""
    blocks = -(-dimension // 4)  # of four numbers for a step of the counter
    different, places = np.unique(indices, return_inverse=True)
    runs = np.split(different, np.flatnonzero(np.diff(different) > 1) + 1)
    bits = [np.random.Philox(key=seed, counter=int(run[0]) * blocks).random_raw(4 * blocks * len(run)) for run in runs]
    words = np.concatenate(bits).reshape(-1, 4 * blocks)[places, :dimension]
    return (words >> np.uint64(11)).astype(float) * 2.0**-53


def latin_hypercube(indices: Int[np.ndarray, " points"], count: int, dimension: int, seed: int) -> np.ndarray:
    """A Latin hypercube of ``count`` points: in each dimension, one point in each of ``count`` equal intervals."""
    return _latin_hypercube(count, dimension, seed)[indices]


def sobol(indices: Int[np.ndarray, " points"], count: int, dimension: int, seed: int) -> np.ndarray:
    """The first ``count`` points, a power of two, of Sobol's sequence, scrambled."""
    return _sobol(count, dimension, seed)[indices]


DESIGNS: Mapping[str, Design] = {"random": random, "latin-hypercube": latin_hypercube, "sobol": sobol}


# Each of these points depends on all the others; a process usually needs only one design.
@functools.lru_cache(maxsize=4)
def _latin_hypercube(count: int, dimension: int, seed: int) -> np.ndarray:
    from scipy.stats import qmc

    return qmc.LatinHypercube(dimension, rng=seed).random(count)


@functools.lru_cache(maxsize=4)
def _sobol(count: int, dimension: int, seed: int) -> np.ndarray:
    from scipy.stats import qmc

    return qmc.Sobol(dimension, scramble=True, rng=seed).random(count)
