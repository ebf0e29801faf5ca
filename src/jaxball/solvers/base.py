"""Common to all solvers of this package, and what a run needs to know about any solver."""

from typing import ClassVar

import diffrax
import equinox as eqx

from .stages import AbstractStageIteration

# The part of the time until a singularity that a step may take, if the solver does not say.
APPROACH = 0.5


def approach_of(solver: diffrax.AbstractSolver) -> float:
    """The largest part of the time until a singularity of the solution, such as the end of a slip, for one step.

    It is the solver's attribute ``approach``, from 0 to 1, or 0.5 without one. Near a singularity the scales of time
    are proportional to the time that is left, and a step much longer than them is not stable, which error estimates by
    a few points may not notice. A method whose region of stability is small has a smaller one.
    """
    return getattr(solver, "approach", APPROACH)


class AbstractStageSolver(diffrax.AbstractImplicitSolver, diffrax.AbstractAdaptiveSolver):
    """An implicit one-step method for diffrax whose stages a :class:`AbstractStageIteration` finds."""

    term_structure: ClassVar = diffrax.AbstractTerm

    root_finder: eqx.AbstractVar[AbstractStageIteration]  # pyright: ignore[reportIncompatibleVariableOverride]

    @property
    def root_find_max_steps(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The most iterations before a step is given up."""
        return self.root_finder.max_steps

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)
