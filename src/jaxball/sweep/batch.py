"""What an engine is given: scenarios that differ in numbers alone, stacked."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..scenario import Scenario
from .reductions import Find


class Batch(NamedTuple):
    """Scenarios that differ in numbers alone, each array with them as its leading axis. All arrays are NumPy's.

    - ``template``: what all have in common: its ``solver``, ``max_steps``, ``step_to_times``, ``dae`` and ``project``
      hold for all of them, its numbers for none.
    - ``system``, ``state``: as those of a scenario, every leaf stacked.
    - ``times``: the times to save, as many for each scenario; the first and the last alone where nothing looks at
      those between.
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
        """Some of the scenarios, by a slice or by their places."""
        stacked = {name: getattr(self, name) for name in ("system", "times", "state", "rtol", "atol", "contact")}
        return self._replace(**jax.tree.map(lambda leaf: leaf[rows], stacked))

    def shared_once(self) -> tuple[Any, Any]:
        """System and state, with the arrays that do not change as a single one has them."""
        return jax.tree.map(
            lambda axis, part: jax.tree.map(lambda leaf: leaf[0], part) if axis is None else part,
            self.in_axes,
            (self.system, self.state),
            is_leaf=lambda axis: axis is None,
        )


class Wanted(NamedTuple):
    """What an engine is asked for.

    - ``contact``: whether to find the extremes of the contact force.
    - ``detachment``: whether a run ends where the ball would leave the plane.
    - ``finds``: what else to find.
    - ``most``: the largest number of scenarios that a call has in this study.
    - ``threads``: how many cores it may use.
    """

    contact: bool
    detachment: bool
    finds: tuple[Find, ...]
    most: int
    threads: int = 1


# From scenarios to arrays with the scenarios as leading axis: `status`, `steps`, `rejected`, `reached`, the entries of
# the state at each of a scenario's times, and the extremes of the contact force where wanted.
# It must be a function of a module, so that it can be sent to a worker.
Engine = Callable[[Batch, Wanted], dict[str, np.ndarray]]
