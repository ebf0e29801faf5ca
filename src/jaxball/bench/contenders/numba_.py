"""A problem's equations compiled by Numba, for the packages that call a Python or a C function."""

import functools
import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..problem import Piece, Problem
from ..translate import jacobian_source, python_source

# Untyped, because it need not be installed where types are checked.
numba: Any = importlib.import_module("numba")

VECTOR, MATRIX, NUMBER = numba.float64[::1], numba.float64[:, ::1], numba.float64


@dataclass(frozen=True)
class Compiled:
    """A compiled function (t, x, p, out) that fills ``out``, and its compile time in seconds."""

    fill: Callable[[float, np.ndarray, np.ndarray, np.ndarray], None]
    seconds: float


@functools.cache
def compiled_rates(problem: Problem) -> Compiled:
    """f, for which ``out`` is a vector."""
    source = python_source(problem.rates, len(problem.initial), len(problem.pieces[0].parameters))
    return _compiled(source, "rates", VECTOR)


@functools.cache
def compiled_jacobian(problem: Problem) -> Compiled:
    """∂f/∂x, exact, for which ``out`` is a matrix."""
    source = jacobian_source(problem.rates, len(problem.initial), len(problem.pieces[0].parameters))
    return _compiled(source, "jacobian", MATRIX)


def parameters(piece: Piece) -> np.ndarray:
    """The parameters of ``piece``; Numba needs an array even if there are none."""
    return np.array(piece.parameters, dtype=float)


def _compiled(source: str, name: str, out: Any) -> Compiled:
    start = time.perf_counter()
    names: dict[str, object] = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt}
    exec(source, names)
    fill = numba.njit(numba.void(NUMBER, VECTOR, VECTOR, out))(names[name])
    return Compiled(fill, time.perf_counter() - start)
