"""Lengths of vectors of any size."""

import numpy as np
from jaxtyping import Float


def length(x: Float[np.ndarray, "*batch n"]) -> Float[np.ndarray, "*batch"]:
    """|x| over the last axis, of numbers whose squares overflow or vanish as well; infinite where |x| is too large.

    Numbers are scaled by a power of two, which changes no bit of what ``numpy.linalg.norm`` makes of ordinary ones.
    """
    largest = np.max(np.abs(x), axis=-1)
    exponent = np.where(np.isfinite(largest), np.frexp(largest)[1], 0)
    with np.errstate(over="ignore"):
        return np.asarray(np.ldexp(np.linalg.norm(np.ldexp(x, -exponent[..., None]), axis=-1), exponent))
