"""numbalsoda: LSODA in C++ and Hairer's DOP853 in Fortran around a C function compiled by Numba."""

import functools
import importlib
import inspect
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..problem import Problem
from . import MAX_STEPS_OF_BENCH, Outcome, Program, Run, Work
from .scipy_ import compile_rates

# Untyped, because it need not be installed where types are checked.
numba: Any = importlib.import_module("numba")
numbalsoda: Any = importlib.import_module("numbalsoda")

METHODS = {"LSODA": numbalsoda.lsoda, "DOP853": numbalsoda.dop853}


def program(method: str, problem: Problem) -> Program:
    """The problem in one of :data:`METHODS`, compiled from piece to piece."""
    start = time.perf_counter()
    rates = compile_rates(problem)
    run = functools.partial(_Run, problem, advance(method), right_hand_side(problem))
    run(1e-3).solve()  # Numba compiles for the types of the first call
    return Program(max(time.perf_counter() - start, rates.seconds), run)


class Legs(NamedTuple):
    """The start and the end of each piece, and, beside t and x, the arguments of the C function on it.

    These are a counter of its calls, and the parameters.
    """

    ends: np.ndarray
    data: np.ndarray

    @classmethod
    def of(cls, problem: Problem) -> "Legs":
        """Those of a problem."""
        pieces = problem.pieces
        ends = np.array([[piece.start, piece.end] for piece in pieces])
        return cls(ends, np.array([(0.0, *piece.parameters) for piece in pieces]))


class _Run(Run):
    def __init__(self, problem: Problem, advance: Callable[..., Any], right_hand_side: Any, tolerance: float):
        self._legs = Legs.of(problem)
        self._advance, self._right_hand_side = advance, right_hand_side  # whose address must stay that of a function
        x, tolerances = np.array(problem.initial, dtype=float), (tolerance, tolerance * problem.atol_over_rtol)
        self._arguments = (right_hand_side.address, x, *self._legs, *tolerances, MAX_STEPS_OF_BENCH)

    def solve(self) -> tuple[np.ndarray, bool]:
        return self._advance(*self._arguments)

    def outcome(self) -> Outcome:
        self._legs.data[:, 0] = 0
        x, succeeded = self.solve()
        failure = "" if succeeded else "it reports no success, and no reason"
        return Outcome(x, failure, Work(evaluations=int(self._legs.data[:, 0].sum())))


def advance(name: str) -> Callable[..., tuple[np.ndarray, bool]]:
    """The final state by one of :data:`METHODS`, and whether it succeeded, compiled.

    It is a function of the address of the C function, the initial state, the :class:`Legs`, the tolerances and the
    largest number of steps.
    """
    method = METHODS[name]

    def advance(address, x, ends, data, rtol, atol, most_steps):
        succeeded = True
        for k in range(len(ends)):
            states, well = method(address, x, ends[k], data[k], rtol, atol, most_steps)
            x = states[1]
            succeeded = succeeded and well
        return x, succeeded

    # Numba needs the function itself where a type checker has wrapped it.
    return numba.njit(inspect.unwrap(advance))


def right_hand_side(problem: Problem) -> Any:
    """The C function of the rates of ``problem``."""
    rates = compile_rates(problem).fill
    n, size = len(problem.initial), 1 + len(problem.pieces[0].parameters)

    def fill(t, x, out, data):
        own = numba.carray(data, (size,))
        own[0] += 1
        rates(t, numba.carray(x, (n,)), own[1:], numba.carray(out, (n,)))

    return numba.cfunc(numbalsoda.lsoda_sig)(inspect.unwrap(fill))
