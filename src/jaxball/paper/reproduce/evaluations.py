"""Counts how often a solver evaluates the right-hand side, by observing it and not by a formula."""

from collections.abc import Callable
from typing import ClassVar

import diffrax
import equinox as eqx
import jax

from ...solvers import AbstractWrappingSolver


class Counter:
    """A count on the host that a compiled solve increments."""

    def __init__(self):
        self.count = 0

    def __call__(self) -> None:
        self.count += 1

    def read(self) -> int:
        """The count, once every solve that was started has finished."""
        jax.effects_barrier()
        return self.count


class CountingTerm(diffrax.AbstractTerm):
    """``term`` itself, which calls ``tick`` on the host each time its vector field is evaluated."""

    transparent: ClassVar[bool] = True

    term: diffrax.AbstractTerm
    tick: Callable[[], None] = eqx.field(static=True)

    def vf(self, t, y, args):
        jax.debug.callback(self.tick)
        return self.term.vf(t, y, args)

    def contr(self, t0, t1, **kwargs):
        return self.term.contr(t0, t1, **kwargs)

    def prod(self, vf, control):
        return self.term.prod(vf, control)

    def is_vf_expensive(self, t0, t1, y, args):
        return self.term.is_vf_expensive(t0, t1, y, args)


class CountingSolver(AbstractWrappingSolver):
    """``solver`` itself, for an ordinary differential equation, which counts its evaluations with ``tick``.

    A Jacobian counts as one evaluation, because it is one pass through the right-hand side with all its tangents.
    """

    solver: diffrax.AbstractSolver  # pyright: ignore[reportIncompatibleVariableOverride]
    tick: Callable[[], None] = eqx.field(static=True)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(self._counted(terms), t0, t1, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        return self.solver.step(self._counted(terms), t0, t1, y0, args, solver_state, made_jump)

    def func(self, terms, t0, y0, args):
        return self.solver.func(self._counted(terms), t0, y0, args)

    def _counted(self, term: diffrax.AbstractTerm) -> CountingTerm:
        return CountingTerm(term, self.tick)
