"""The contract of feedback on a motion, and feedforward alone."""

import abc
from typing import Any

from jaxtyping import Array, Float, Int

from ..interface.printing import Printed
from .nominal import NominalMotion
from .sampled import PlacedState, SampledSystem


class AbstractFeedback(Printed):
    """What adds to the inputs of a nominal motion, at each sample, by the state measured there.

    A kind of feedback implements ``__call__``, and ``begin`` if it remembers something from sample to sample, and
    ``applied`` if that depends on the inputs which act in the end. All are traced, for one state.

    - ``sampled``: the robot that it is designed for.
    - ``nominal``: the motion that it holds.
    """

    sampled: SampledSystem
    nominal: NominalMotion

    def begin(self) -> Any:
        """What it remembers before the first sample: a PyTree of arrays."""
        return ()

    @abc.abstractmethod
    def __call__(self, k: Int[Array, ""], state: PlacedState, memory: Any) -> tuple[Float[Array, " m"], Any]:
        """δu of sample ``k`` at ``state``, before limits, and what it remembers of it."""

    def applied(self, k: Int[Array, ""], u: Float[Array, " m"], memory: Any) -> Any:
        """What it remembers of sample ``k`` once it is known which inputs act, after delay and limits."""
        return memory

    def estimated(self, times: Float[Array, " T"], memory: Any) -> Any:
        """What it has estimated at the samples of a run and its end, by what it remembers then; None if nothing."""
        return None

    def deviation(self, k: Int[Array, ""], state: PlacedState) -> Float[Array, " n"]:
        """ξ: the local coordinates of ``state`` around that of the motion at sample ``k``."""
        return self.nominal.state(k).difference(state)


class Feedforward(AbstractFeedback):
    """No feedback: the inputs of the motion alone, whatever happens.

    **Arguments:**

    - ``sampled``, ``nominal``: those of a feedback, to compare with it.
    """

    def __call__(self, k, state, memory):
        return self.nominal.input(k) * 0.0, memory
