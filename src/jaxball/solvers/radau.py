"""Radau IIA."""

import equinox as eqx

from .collocation import AbstractCollocation
from .errors import AbstractErrorEstimate, EmbeddedError
from .newton import SimplifiedNewton
from .stages import AbstractStageIteration
from .tableau import radau_right


class RadauIIA(AbstractCollocation):
    stages: int = eqx.field(static=True, default=3)
    root_finder: AbstractStageIteration = SimplifiedNewton()
    error: AbstractErrorEstimate = EmbeddedError()

    @property
    def tableau(self):
        return radau_right(self.stages)

    def order(self, terms):
        return 2 * self.stages - 1
