"""Gauss."""

import equinox as eqx

from .collocation import AbstractCollocation
from .errors import AbstractErrorEstimate, TailError
from .fixed_point import FixedPoint
from .stages import AbstractStageIteration
from .tableau import gauss


class Gauss(AbstractCollocation):
    stages: int = eqx.field(static=True, default=8)
    root_finder: AbstractStageIteration = FixedPoint()
    error: AbstractErrorEstimate = TailError()

    @property
    def tableau(self):
        return gauss(self.stages)

    def order(self, terms):
        return 2 * self.stages
