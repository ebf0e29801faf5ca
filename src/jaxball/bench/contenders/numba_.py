"""A problem's equations compiled by Numba, for the packages that call a Python or a C function."""

import math
from collections.abc import Callable

import numba  # pyright: ignore[reportMissingImports]
import numpy as np

from ..problem import Piece, Problem
from ..translate import jacobian_source, python_source

VECTOR, MATRIX, NUMBER = numba.float64[::1], numba.float64[:, ::1], numba.float64
Filling = Callable[[float, np.ndarray, np.ndarray, np.ndarray], None]


def compiled_rates(problem: Problem) -> Filling:
    """f as ``rates(t, x, p, out)``, which fills ``out``; compiled when this returns."""
    source = python_source(problem.rates, len(problem.initial), len(problem.pieces[0].parameters))
    return _compiled(source, "rates", VECTOR)


def compiled_jacobian(problem: Problem) -> Filling:
    """∂f/∂x as ``jacobian(t, x, p, out)``, exact, which fills the matrix ``out``; compiled when this returns."""
    source = jacobian_source(problem.rates, len(problem.initial), len(problem.pieces[0].parameters))
    return _compiled(source, "jacobian", MATRIX)


def parameters(piece: Piece) -> np.ndarray:
    """The parameters of ``piece``; Numba wants an array even where there are none."""
    return np.array(piece.parameters, dtype=float)


def _compiled(source: str, name: str, out: object) -> Filling:
    names: dict[str, object] = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt}
    exec(source, names)
    return numba.njit(numba.void(NUMBER, VECTOR, VECTOR, out))(names[name])
