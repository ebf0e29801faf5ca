"""SciPy's integrators around a right-hand side, and an exact Jacobian, compiled by Numba."""

import functools
from dataclasses import dataclass

import numpy as np
import scipy.integrate

from ..problem import Piece, Problem
from .base import MAX_STEPS, NO_WORK, Outcome, Program, Run, Work
from .numba_ import Compiled, compiled_jacobian, compiled_rates, parameters

METHODS = {
    "RK45": scipy.integrate.RK45,
    "DOP853": scipy.integrate.DOP853,
    "LSODA": scipy.integrate.LSODA,
    "Radau": scipy.integrate.Radau,
    "BDF": scipy.integrate.BDF,
}
EXPLICIT = ("RK45", "DOP853")


def program(method: str, problem: Problem) -> Program:
    """The problem in one of :data:`METHODS`."""
    jacobian = None if method in EXPLICIT else compiled_jacobian(problem)
    rates = compiled_rates(problem)
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
        while solver.status == "running" and steps < MAX_STEPS:
            message = solver.step()
            steps += 1
        failure = {"finished": "", "running": f"it took {MAX_STEPS} steps"}.get(solver.status, str(message).rstrip("."))
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
