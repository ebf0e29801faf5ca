"""When an event happened, and where the system was then."""

from typing import Any

import numpy as np
from jaxtyping import Array, Float, Int

from ..interface.printing import Printed, is_single, shown


class Occurrences(Printed):
    """The occurrences of one event in a run, in the order of time.

    - ``count``: how many there were.
    - ``times``: when, shape (room,); NaN where there are fewer.
    - ``state``: the states then; each of its arrays has ``room`` as leading axis.
    - ``least``, ``largest``: the extreme values of the event's function, where the solve evaluated it.

    Times and states are differentiable, ``least`` and ``largest`` are not.
    """

    count: Int[Array, "*batch"]
    times: Float[Array, "*batch room"]
    state: Any
    least: Float[Array, "*batch"]
    largest: Float[Array, "*batch"]

    def __repr__(self) -> str:
        return f"Occurrences: {self.message}" if is_single(self.count) else shown(self)

    @property
    def message(self) -> str:
        """A sentence on how often it happened. For one trajectory, not for a batch."""
        count, room = int(self.count), self.times.shape[-1]
        span = f"its function was between {float(self.least):.6g} and {float(self.largest):.6g}"
        if count == 0:
            return f"It never happened: {span}, and did not cross zero in the direction asked for."
        first = f"first at t = {float(np.asarray(self.times)[0]):.10g}"
        if count == 1:
            return f"It happened once, at t = {float(np.asarray(self.times)[0]):.10g}."
        if count <= room:
            return f"It happened {count} times, {first}."
        return f"It happened {count} times, {first}; the first {room} are kept, and a larger `room` would keep more."
