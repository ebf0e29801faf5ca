"""SciPy's integrators, and a problem's equations and exact Jacobian compiled by Numba."""

import functools
import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.integrate

from ..problem import Piece, Problem
from ..translate import jacobian_source, python_source
from . import MAX_STEPS_OF_BENCH, NO_WORK, Outcome, Program, Run, Work

# Untyped, because it need not be installed where types are checked.
numba: Any = importlib.import_module("numba")

VECTOR, MATRIX, NUMBER = numba.float64[::1], numba.float64[:, ::1], numba.float64
METHODS = {
    "RK45": scipy.integrate.RK45,
    "DOP853": scipy.integrate.DOP853,
    "LSODA": scipy.integrate.LSODA,
    "Radau": scipy.integrate.Radau,
    "BDF": scipy.integrate.BDF,
}
EXPLICIT = ("RK45", "DOP853")


@dataclass(frozen=True)
class Compiled:
    """A compiled function (t, x, p, out) that fills ``out``, and its compile time in seconds."""

    fill: Callable[[float, np.ndarray, np.ndarray, np.ndarray], None]
    seconds: float


@functools.cache
def compile_rates(problem: Problem) -> Compiled:
    """Compiles f, for which ``out`` is a vector."""
    source = python_source(problem.rates, len(problem.initial), len(problem.pieces[0].parameters))
    return _compile(source, "rates", VECTOR)


@functools.cache
def compile_jacobian(problem: Problem) -> Compiled:
    """Compiles ∂f/∂x, exact, for which ``out`` is a matrix."""
    source = jacobian_source(problem.rates, len(problem.initial), len(problem.pieces[0].parameters))
    return _compile(source, "jacobian", MATRIX)


def parameters(piece: Piece) -> np.ndarray:
    """The parameters of ``piece``; Numba needs an array even if there are none."""
    return np.array(piece.parameters, dtype=float)


def _compile(source: str, name: str, out: Any) -> Compiled:
    start = time.perf_counter()
    names: dict[str, object] = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt}
    exec(source, names)
    fill = numba.njit(numba.void(NUMBER, VECTOR, VECTOR, out))(names[name])
    return Compiled(fill, time.perf_counter() - start)


def program(method: str, problem: Problem) -> Program:
    """The problem in one of :data:`METHODS`."""
    jacobian = None if method in EXPLICIT else compile_jacobian(problem)
    rates = compile_rates(problem)
    build_time = rates.seconds + (jacobian.seconds if jacobian else 0.0)
    return Program(build_time, functools.partial(_Run, method, problem, rates, jacobian))


@dataclass(frozen=True)
class _Run(Run):
    """Steps the solver directly, because ``solve_ivp`` would also keep every state, and does not count steps."""

    method: str
    problem: Problem
    rates: Compiled
    jacobian: Compiled | None
    tolerance: float

    def solve(self) -> tuple[np.ndarray, str, Work]:
        x, work = np.array(self.problem.initial, dtype=float), NO_WORK
        for piece in self.problem.pieces:
            x, failure, counted = self._advance(piece, x)
            work = work + counted
            if failure:
                return x, failure, work
        return x, "", work

    def outcome(self) -> Outcome:
        return Outcome(*self.solve())

    def _advance(self, piece: Piece, x: np.ndarray) -> tuple[np.ndarray, str, Work]:
        solver = self._solver(piece, x)
        steps, message = 0, ""
        while solver.status == "running" and steps < MAX_STEPS_OF_BENCH:
            message = solver.step()
            steps += 1
        failure = {"finished": "", "running": f"it took {MAX_STEPS_OF_BENCH} steps"}.get(
            solver.status, str(message).rstrip(".")
        )
        implicit = self.jacobian is not None
        counted = Work(
            steps=steps,
            evaluations=solver.nfev,
            jacobians=int(solver.njev) if implicit else None,
            decompositions=solver.nlu if self.method in ("Radau", "BDF") else None,
        )
        return solver.y, failure, counted

    def _solver(self, piece: Piece, x: np.ndarray) -> scipy.integrate.OdeSolver:
        rates, jacobian, p = self.rates, self.jacobian, parameters(piece)

        def field(t, x):
            out = np.empty_like(x)
            rates.fill(t, x, p, out)
            return out

        def matrix(t, x):
            out = np.empty((x.size, x.size))
            assert jacobian is not None
            jacobian.fill(t, x, p, out)
            return out

        rtol, atol = self.tolerance, self.tolerance * self.problem.atol_over_rtol
        exact = {} if jacobian is None else {"jac": matrix}
        return METHODS[self.method](field, piece.start, x, piece.end, rtol=rtol, atol=atol, **exact)
