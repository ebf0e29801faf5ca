"""Nonlinear least squares where the data may not determine all unknowns.

The estimators of parameters use it: ``design.identify`` and ``estimation.fitting``.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

# Directions to which the data are less sensitive than to the best one by this factor, the square root of rounding, are
# unseen.
UNSEEN, ROUNDING_OF_FIT = 1e-7, 1e-12
# The search ends when a step gains less than this fraction of the sum of squares, or is shorter than this fraction of
# |y|.
GAIN, SHORT_FIT_STEP, EVALUATIONS = 1e-9, 1e-9, 60

# The residuals at the unknowns y, and their Jacobian.
Residuals = Callable[[tuple[float, ...]], tuple[Float[np.ndarray, " residuals"], Float[np.ndarray, "residuals n"]]]


def find_determined(singular_values: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Returns which directions of a Jacobian with these singular values the data determine."""
    return singular_values > UNSEEN * singular_values[0]


def where_finite(residuals: Callable[[tuple[float, ...]], tuple[Any, Any]]) -> Residuals:
    """Returns the same function of residuals, kept for the last unknowns, with residuals that are all NaN where the
    Jacobian is not finite.
    """

    @functools.lru_cache(maxsize=1)
    def evaluate(y: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        r, J = map(np.asarray, residuals(y))
        # NaN tells SciPy that a step went too far; it reads residuals only.
        return (r, J) if np.all(np.isfinite(J)) else (np.full_like(r, np.nan), J)

    return evaluate


def fit_unknowns(residuals: Residuals, start: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], bool]:
    """Finds the unknowns with the least sum of squares near ``start``, and whether the last step was negligible.

    By Levenberg's and Marquardt's method as in SciPy, which shortens a step to where residuals are NaN. No step is
    taken along directions that the data do not determine.
    """

    def jacobian_of_determined(y: Float[np.ndarray, " n"]) -> Float[np.ndarray, "residuals n"]:
        U, s, Vt = np.linalg.svd(residuals(tuple(y))[1], full_matrices=False)
        jacobian = (U * np.where(find_determined(s), s, 0.0)) @ Vt
        # SciPy scales unknowns by their columns, and would take the rounding in an empty one for a sensitivity.
        return np.where(np.abs(jacobian) > ROUNDING_OF_FIT * s[0], jacobian, 0.0)

    fit = least_squares(
        lambda y: residuals(tuple(y))[0],
        start,
        jacobian_of_determined,  # pyright: ignore[reportArgumentType]
        x_scale="jac",
        ftol=GAIN,
        xtol=SHORT_FIT_STEP,
        gtol=None,  # pyright: ignore[reportArgumentType]
        max_nfev=EVALUATIONS,
    )
    return fit.x, fit.success
