"""What is common to all that a user's function gives: a rail, a schedule, a motion, a force, a law."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float, PyTree

from ..interface.printing import Printed
from ..numerics.arrays import numbers


class OfFunction(Printed):
    """A function of arguments that its subclass names, and of ``parameters``."""

    function: Callable[..., Any] = eqx.field(static=True)
    parameters: PyTree = None


class OfKinkedFunction(OfFunction):
    """The same of the time, with the times at which it jumps or has a kink."""

    kink_times: Float[Array, "*group kinks"] = eqx.field(converter=numbers("kink_times", ("kinks",)), default=())

    def kinks(self) -> Float[Array, " kinks"]:
        return self.kink_times
