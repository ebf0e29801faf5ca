"""heyoka: Taylor series of an order chosen by the tolerance, compiled by LLVM."""

import functools
import importlib
from typing import Any

import numpy as np

from ..problem import Problem
from ..translate import heyoka_system
from . import MAX_STEPS_OF_BENCH, Outcome, Program, Run, Work

# Untyped, because it need not be installed where types are checked.
heyoka: Any = importlib.import_module("heyoka")

ENDED_AT_THE_TIME = heyoka.taylor_outcome.time_limit


def program(method: str, problem: Problem) -> Program:
    """The problem in ``Taylor``, the only method of heyoka."""
    heyoka.llvm_state.set_diskcache_enabled(False)  # so that the build time is real
    return Program(0.0, functools.partial(_Run, problem))


class _Run(Run):
    """heyoka has one tolerance, relative to the largest component where that is above 1, and absolute below."""

    def __init__(self, problem: Problem, tolerance: float):
        parameters = len(problem.pieces[0].parameters)
        system = heyoka_system(problem.rates, len(problem.initial), parameters)
        self._problem = problem
        self._initial = np.array(problem.initial, dtype=float)
        self._integrator = heyoka.taylor_adaptive(
            system, self._initial.copy(), time=problem.start, tol=tolerance, pars=[0.0] * parameters
        )

    def solve(self) -> list[tuple]:
        integrator = self._integrator
        integrator.time = self._problem.start
        integrator.state[:] = self._initial
        ends = []
        for piece in self._problem.pieces:
            integrator.pars[:] = piece.parameters
            ends.append(integrator.propagate_until(piece.end, max_steps=MAX_STEPS_OF_BENCH))
        return ends

    def outcome(self) -> Outcome:
        ends = self.solve()
        failures = [str(end[0]) for end in ends if end[0] != ENDED_AT_THE_TIME]
        return Outcome(
            self._integrator.state.copy(),
            failures[0] if failures else "",
            Work(steps=sum(end[3] for end in ends), rejected=0),
        )
