"""The least value of a function along a solve."""

from collections.abc import Callable
from typing import Any

import diffrax
import jax.numpy as jnp
from jaxtyping import Array, Float

Watch = Callable[[Float[Array, ""], Float[Array, " size"], Any], Float[Array, ""]]


class Watching(diffrax.AbstractAdaptiveSolver, diffrax.AbstractWrappedSolver):
    """``solver``, with the least value of ``of(t, x, args)`` at the ends of its steps, not at the start, in its state.

    It takes the same few operations in every step, as many solves side by side want it. What it misses between two ends
    is at most (step)² / 8 times the second derivative.
    """

    solver: diffrax.AbstractSolver  # pyright: ignore[reportIncompatibleVariableOverride]
    of: Watch

    @property
    def term_structure(self) -> Any:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The terms that the inner solver takes."""
        return self.solver.term_structure

    @property
    def interpolation_cls(self) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The inner solver's dense output."""
        return self.solver.interpolation_cls

    @property
    def root_finder(self) -> Any:
        """The root finder of an implicit solver, where diffrax puts the tolerances."""
        return self.solver.root_finder  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def scan_kind(self) -> Any:
        """The kind of loop of an explicit solver, where ``diffrax.ForwardMode`` puts one that has a jvp."""
        return self.solver.scan_kind  # pyright: ignore[reportAttributeAccessIssue]

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms, t0, t1, y0, args), jnp.full((), jnp.inf, y0.dtype)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        inner, least = solver_state
        y1, y_error, dense, inner, result = self.solver.step(terms, t0, t1, y0, args, inner, made_jump)
        least = jnp.minimum(least, self.of(jnp.asarray(t1), y1[0], args))
        return y1, y_error, dense, (inner, least), result

    def func(self, terms, t0, y0, args):
        return self.solver.func(terms, t0, y0, args)
