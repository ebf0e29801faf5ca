"""Common to the classical systems: each has laws, quantities that are conserved along its motions."""

import abc
from typing import Any

from jaxtyping import Array, Float

from ..physics.system import AbstractState, AbstractSystem, AnyState


class AbstractClassicalState(AbstractState):
    """The state that a solve of a classical system advances: arrays, at rest by default."""


class AbstractClassicalSystem(AbstractSystem[AnyState]):
    """Parameters of a classical system, with its equations of motion and the laws that these imply.

    It fulfils the contract of :class:`~jaxball.AbstractSystem`, of which it implements ``field`` and ``laws``.
    """

    @abc.abstractmethod
    def laws(self, t: Float[Array, ""], state: AnyState) -> Any:
        """A named tuple of quantities that are conserved along every motion, or when its entries say so."""
