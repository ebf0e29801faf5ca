"""CasADi with CVODES and IDAS of SUNDIALS, its functions compiled by the C compiler if there is one."""

import contextlib
import functools
import importlib
import math
import shutil
import tempfile
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..problem import Piece, Problem
from ..translate import casadi_dae
from . import MAX_STEPS_OF_BENCH, NO_WORK, Outcome, Program, Run, Work

# Untyped, because it need not be installed where types are checked.
casadi: Any = importlib.import_module("casadi")

METHODS: dict[str, tuple[str, dict[str, Any]]] = {
    "CVODES Adams": ("cvodes", {"linear_multistep_method": "adams", "nonlinear_solver_iteration": "functional"}),
    "CVODES BDF": ("cvodes", {"linear_multistep_method": "bdf", "nonlinear_solver_iteration": "newton"}),
    "IDAS": ("idas", {}),
}
COMPILER = "gcc"
FLAGS = ["-O3", "-march=native"]


@contextlib.contextmanager
def compiling() -> Iterator[dict[str, Any]]:
    """The options by which CasADi compiles to C what is built within; none without a compiler.

    It writes to the current folder, which is a temporary one meanwhile, and what it has loaded needs no file.
    """
    if shutil.which(COMPILER) is None:
        yield {}
        return
    shell = {"compiler": COMPILER, "flags": FLAGS, "cleanup": False}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        yield {"jit": True, "compiler": "shell", "jit_cleanup": False, "jit_options": shell}


def program(method: str, problem: Problem) -> Program:
    """The problem in one of :data:`METHODS`."""
    return Program(0.0, functools.partial(_Run, method, problem))


class _Leg:
    """One piece with its own integrator; CasADi fixes interval and tolerances when it builds one."""

    def __init__(self, method: str, problem: Problem, piece: Piece, tolerance: float):
        solver, options = METHODS[method]
        options = options | {
            "reltol": tolerance,
            "abstol": tolerance * problem.atol_over_rtol,
            "max_num_steps": MAX_STEPS_OF_BENCH,
        }
        if solver == "idas":
            options |= _idas_options(problem, piece)
        equations = casadi_dae(problem, piece)
        with compiling() as compiled:
            self.integrator = casadi.integrator("leg", solver, equations, piece.start, piece.end, options | compiled)
        self.p = casadi.DM(piece.parameters)
        self.algebraic = piece.algebraic

    def advance(self, x: np.ndarray) -> np.ndarray:
        k = self.algebraic
        if k is None:
            return self.integrator(x0=x, p=self.p)["xf"].full().ravel()
        ended = self.integrator(x0=np.delete(x, k), z0=x[k], p=self.p)
        return np.insert(ended["xf"].full().ravel(), k, float(ended["zf"]))

    def work(self) -> Work:
        stats = self.integrator.stats()
        return Work(
            steps=stats["nsteps"],
            rejected=stats["netfails"],
            evaluations=stats["nfevals"],
            jacobians=stats["n_call_jacF"],
            decompositions=stats["nlinsetups"],
        )


def _idas_options(problem: Problem, piece: Piece) -> dict[str, Any]:
    """Without the initial rates, IDAS fails to find consistent ones for Robertson's reaction; with the algebraic
    component in its error test, it never finishes there.
    """
    k = piece.algebraic
    options: dict[str, Any] = {} if k is None else {"suppress_algebraic": True}
    if piece is problem.pieces[0]:
        rates = problem.rates(piece.start, problem.initial, piece.parameters, math)  # pyright: ignore
        options["init_xdot"] = [float(rate) for i, rate in enumerate(rates) if i != k]
    return options


class _Run(Run):
    def __init__(self, method: str, problem: Problem, tolerance: float):
        self._initial = np.array(problem.initial, dtype=float)
        self._legs = [_Leg(method, problem, piece, tolerance) for piece in problem.pieces]

    def solve(self) -> np.ndarray:
        x = self._initial
        for leg in self._legs:
            x = leg.advance(x)
        return x

    def outcome(self) -> Outcome:
        """A solve that fails raises, so that one that returns has succeeded."""
        x = self.solve()
        return Outcome(x, "", sum((leg.work() for leg in self._legs), start=NO_WORK))
