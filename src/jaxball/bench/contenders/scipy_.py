"""SciPy's integrators around a right-hand side, and an exact Jacobian, compiled by Numba."""

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
    return _Program(rates.seconds + (jacobian.seconds if jacobian else 0.0), method, problem, rates, jacobian)


@dataclass(frozen=True)
class _Program(Program):
    method: str
    problem: Problem
    rates: Compiled
    jacobian: Compiled | None

    def run(self, tolerance: float) -> Run:
        return _Run(self, tolerance)


@dataclass(frozen=True)
class _Run(Run):
    """Steps its solver itself, because ``solve_ivp`` would also keep every state, and counts no steps."""

    program: _Program
    tolerance: float

    def solve(self) -> tuple[np.ndarray, str, Work]:
        x, work = np.array(self.program.problem.initial, dtype=float), NO_WORK
        for piece in self.program.problem.pieces:
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
        implicit = self.program.jacobian is not None
        counted = Work(
            steps=steps,
            evaluations=solver.nfev,
            jacobians=int(solver.njev) if implicit else None,
            decompositions=solver.nlu if self.program.method in ("Radau", "BDF") else None,
        )
        return solver.y, failure, counted

    def _solver(self, piece: Piece, x: np.ndarray) -> scipy.integrate.OdeSolver:
        program, p = self.program, parameters(piece)
        rates, jacobian = program.rates, program.jacobian

        def field(t, x):
            out = np.empty_like(x)
            rates.fill(t, x, p, out)
            return out

        def matrix(t, x):
            out = np.empty((x.size, x.size))
            assert jacobian is not None
            jacobian.fill(t, x, p, out)
            return out

        rtol, atol = self.tolerance, self.tolerance * program.problem.atol_over_rtol
        exact = {} if jacobian is None else {"jac": matrix}
        return METHODS[program.method](field, piece.start, x, piece.end, rtol=rtol, atol=atol, **exact)
