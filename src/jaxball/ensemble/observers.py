"""What is looked at in each step of a lane, so that no more than results is kept of a run."""

import abc
from typing import Any

from jaxtyping import Array, Bool

from .runge_kutta import Step


class AbstractObserver(abc.ABC):
    """Sees every step. What it has seen is a PyTree of arrays whose last axis is that of the lanes."""

    @abc.abstractmethod
    def begin(self, given: Any) -> Any:
        """What it has seen at the start of a run. ``given`` are the numbers of each lane that it looks with."""

    @abc.abstractmethod
    def observe(self, seen: Any, given: Any, step: Step, kept: Bool[Array, " lanes"]) -> Any:
        """What it has seen after a step in the lanes where that was kept; as before in the others."""
