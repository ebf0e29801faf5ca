"""numbalsoda: LSODA in C++ and Hairer's DOP853 in Fortran around a C function compiled by Numba."""

import functools
import importlib
import inspect
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ..problem import Problem
from .base import MAX_STEPS, Outcome, Program, Run, Work
from .scipy_ import Compiled, compiled_rates

# Untyped, because it need not be installed where types are checked.
numba: Any = importlib.import_module("numba")
numbalsoda: Any = importlib.import_module("numbalsoda")

METHODS = {"LSODA": numbalsoda.lsoda, "DOP853": numbalsoda.dop853}


def program(method: str, problem: Problem) -> Program:
    """The problem in one of :data:`METHODS`, compiled from piece to piece."""
    start = time.perf_counter()
    rates = compiled_rates(problem)
    run = functools.partial(_Run, problem, _advance(METHODS[method]), _right_hand_side(problem, rates))
    run(1e-3).solve()  # Numba compiles for the types of the first call
    return Program(max(time.perf_counter() - start, rates.seconds), run)


class _Run(Run):
    def __init__(
        self,
        problem: Problem,
        advance: Callable[..., tuple[np.ndarray, bool]],
        right_hand_side: Any,
        tolerance: float,
    ):
        ends = np.array([[piece.start, piece.end] for piece in problem.pieces])
        # The other arguments of the C function, besides t and x: its counter, and the parameters.
        data = np.array([(0.0, *piece.parameters) for piece in problem.pieces])
        tolerances = (tolerance, tolerance * problem.atol_over_rtol)
        x = np.array(problem.initial, dtype=float)
        self._advance, self._right_hand_side = advance, right_hand_side  # whose address must stay that of a function
        self._arguments = (right_hand_side.address, x, ends, data, *tolerances, MAX_STEPS)
        self._data = data

    def solve(self) -> tuple[np.ndarray, bool]:
        return self._advance(*self._arguments)

    def outcome(self) -> Outcome:
        self._data[:, 0] = 0
        x, succeeded = self.solve()
        failure = "" if succeeded else "it reports no success, and no reason"
        return Outcome(x, failure, Work(evaluations=int(self._data[:, 0].sum())))


def _advance(method: Callable) -> Callable[..., tuple[np.ndarray, bool]]:
    def advance(address, x, ends, data, rtol, atol, most_steps):
        succeeded = True
        for k in range(len(ends)):
            states, well = method(address, x, ends[k], data[k], rtol, atol, most_steps)
            x = states[1]
            succeeded = succeeded and well
        return x, succeeded

    # Numba needs the function itself where a type checker has wrapped it.
    return numba.njit(inspect.unwrap(advance))


def _right_hand_side(problem: Problem, compiled: Compiled) -> Any:
    rates, n, size = compiled.fill, len(problem.initial), 1 + len(problem.pieces[0].parameters)

    def right_hand_side(t, x, out, data):
        own = numba.carray(data, (size,))
        own[0] += 1
        rates(t, numba.carray(x, (n,)), own[1:], numba.carray(out, (n,)))

    return numba.cfunc(numbalsoda.lsoda_sig)(inspect.unwrap(right_hand_side))
