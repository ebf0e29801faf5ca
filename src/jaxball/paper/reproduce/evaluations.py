"""Counts how often a solver evaluates the right-hand side, by observation rather than by a formula."""

from collections.abc import Callable
from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax

from ...solvers import AbstractMassTerm, AbstractWrappingSolver
from ...solvers.mass import mass_term, unwrapped

Field = Callable[[Any, Any, Any], Any]


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


def counting(field: Field, tick: Callable[[], None]) -> Field:
    """``field``, which calls ``tick`` on the host each time it is evaluated.

    Under ``vmap``, as over the stages of a step, it counts each of them, because it passes t and x through. A Jacobian
    is one evaluation: one pass through the field with all its tangents.
    """

    def counted(t, x, args):
        jax.debug.callback(lambda t, x: tick(), t, x)
        return field(t, x, args)

    return counted


class CountingTerm(diffrax.AbstractTerm):
    """``term`` itself, which calls ``tick`` on the host each time its vector field is evaluated."""

    transparent: ClassVar[bool] = True

    term: diffrax.AbstractTerm
    tick: Callable[[], None] = eqx.field(static=True)

    def vf(self, t, y, args):
        return counting(self.term.vf, self.tick)(t, y, args)

    def contr(self, t0, t1, **kwargs):
        return self.term.contr(t0, t1, **kwargs)

    def prod(self, vf, control):
        return self.term.prod(vf, control)

    def is_vf_expensive(self, t0, t1, y, args):
        return self.term.is_vf_expensive(t0, t1, y, args)


class CountingMassTerm(AbstractMassTerm):
    """``term`` itself, M ẋ = g(t, x), which calls ``tick`` on the host each time g is evaluated."""

    term: AbstractMassTerm
    tick: Callable[[], None] = eqx.field(static=True)

    def at_step(self, t, y, args):
        g, mass = self.term.at_step(t, y, args)
        return counting(g, self.tick), mass


class CountingSolver(AbstractWrappingSolver):
    """``solver`` itself, which counts its evaluations of f(t, x) or, with a mass matrix, of g(t, x) with ``tick``."""

    solver: diffrax.AbstractSolver  # pyright: ignore[reportIncompatibleVariableOverride]
    tick: Callable[[], None] = eqx.field(static=True)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(self._counted(terms), t0, t1, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        return self.solver.step(self._counted(terms), t0, t1, y0, args, solver_state, made_jump)

    def func(self, terms, t0, y0, args):
        return self.solver.func(self._counted(terms), t0, y0, args)

    def _counted(self, term: diffrax.AbstractTerm) -> diffrax.AbstractTerm:
        with_mass = mass_term(term)
        if with_mass is None:
            return CountingTerm(term, self.tick)
        # In its place, because solvers get g from it, and the direction of time from its wrappers.
        return eqx.tree_at(unwrapped, term, CountingMassTerm(with_mass, self.tick))
