"""The input of an engine: scenarios that differ only in numbers, stacked."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..scenario import Scenario
from .reductions import Find


class Batch(NamedTuple):
    """Scenarios that differ only in numbers, stacked along the leading axis of each array. All arrays are NumPy's.

    - ``template``: what all have in common: its ``solver``, ``max_steps``, ``step_to_times``, ``dae`` and ``project``
      apply to all of them; its numbers are not used.
    - ``system``, ``state``: as in a scenario, every leaf stacked.
    - ``times``: the save times, equally many for each scenario; only the first and the last where those between are not
      used.
    - ``rtol``, ``atol``: the tolerances.
    - ``contact``: the law of contact, every leaf stacked, or None.
    - ``in_axes``: 0 for the arrays of ``(system, state)`` that change from row to row, None for the others, as
      :func:`jaxball.ensemble.simulate_ensemble` takes it.
    """

    template: Scenario
    system: Any
    times: Float[np.ndarray, "rows times"]
    state: Any
    rtol: Float[np.ndarray, " rows"]
    atol: Float[np.ndarray, " rows"]
    contact: Any = None
    in_axes: Any = 0

    @property
    def rows(self) -> int:
        """How many scenarios there are."""
        return len(self.times)

    def take(self, rows: Any) -> "Batch":
        """Some of the scenarios, by a slice or by indices."""
        stacked = {name: getattr(self, name) for name in ("system", "times", "state", "rtol", "atol", "contact")}
        return self._replace(**jax.tree.map(lambda leaf: leaf[rows], stacked))

    def shared_once(self) -> tuple[Any, Any]:
        """System and state, with the arrays that do not change unstacked."""
        return jax.tree.map(
            lambda axis, part: jax.tree.map(lambda leaf: leaf[0], part) if axis is None else part,
            self.in_axes,
            (self.system, self.state),
            is_leaf=lambda axis: axis is None,
        )


class Wanted(NamedTuple):
    """What an engine must compute.

    - ``contact``: whether to find the extremes of the contact force.
    - ``detachment``: whether a run ends where the ball would leave the plane.
    - ``finds``: other results.
    - ``most``: the largest number of scenarios in any call of this study.
    - ``threads``: how many cores it may use.
    """

    contact: bool
    detachment: bool
    finds: tuple[Find, ...]
    most: int
    threads: int = 1


# From scenarios to arrays with the scenarios as leading axis: `status`, `steps`, `rejected`, `reached`, the entries of
# the state at each of a scenario's times, and the extremes of the contact force where wanted.
# It must be a module-level function, so that it can be sent to a worker.
Engine = Callable[[Batch, Wanted], dict[str, np.ndarray]]
