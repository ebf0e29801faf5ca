"""Common to all solvers of this package."""

from typing import ClassVar

import diffrax
import equinox as eqx

from .stages import AbstractStageIteration


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
