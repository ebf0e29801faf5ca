"""Common to solvers that wrap another."""

from typing import Any

import diffrax
import equinox as eqx

from .base import approach_of


class AbstractWrappingSolver(diffrax.AbstractAdaptiveSolver, diffrax.AbstractWrappedSolver):
    """A solver that behaves like ``solver``, except for what its subclass changes."""

    solver: eqx.AbstractVar[diffrax.AbstractSolver]  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def term_structure(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The terms that the inner solver takes."""
        return self.solver.term_structure

    @property
    def interpolation_cls(self) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The inner solver's dense output."""
        return self.solver.interpolation_cls

    @property
    def approach(self) -> float:
        """The inner solver's largest part of the time until a singularity for one step."""
        return approach_of(self.solver)

    @property
    def root_finder(self) -> Any:
        """The root finder of an implicit solver, where diffrax puts the tolerances."""
        return self.solver.root_finder  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def controller_cls(self) -> Any:
        """The class of the step-size controllers of a multistep method."""
        return self.solver.controller_cls  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def scan_kind(self) -> Any:
        """The kind of loop of an explicit solver, which ``diffrax.ForwardMode`` replaces by one that has a jvp."""
        return self.solver.scan_kind  # pyright: ignore[reportAttributeAccessIssue]

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms, t0, t1, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        return self.solver.step(terms, t0, t1, y0, args, solver_state, made_jump)

    def func(self, terms, t0, y0, args):
        return self.solver.func(terms, t0, y0, args)
