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
    """

    template: Scenario
    system: Any
    times: Float[np.ndarray, "rows times"]
    state: Any
    rtol: Float[np.ndarray, " rows"]
    atol: Float[np.ndarray, " rows"]

    @property
    def rows(self) -> int:
        """How many scenarios there are."""
        return len(self.times)

    def take(self, rows: Any) -> "Batch":
        """Some of the scenarios, by a slice or by their places."""
        count = len(np.arange(self.rows)[rows])

        def take(leaf: np.ndarray) -> np.ndarray:
            same = leaf.strides[0] == 0  # and stays one number for all
            return np.broadcast_to(leaf[0], (count, *leaf.shape[1:])) if same else leaf[rows]

        return Batch(self.template, *jax.tree.map(take, tuple(self[1:])))


def in_blocks(function: Callable[[Any], Any], stacked: Any, size: int) -> Any:
    """A function of stacked arrays, given ``size`` rows at a time, as NumPy arrays; the last row fills the last block.

    So a program is compiled for one number of rows.
    """
    rows, results = len(jax.tree.leaves(stacked)[0]), []
    for start in range(0, rows, size):
        places = np.minimum(np.arange(start, start + size), rows - 1)
        result = function(jax.tree.map(lambda leaf, places=places: leaf[places], stacked))
        results.append(jax.tree.map(lambda leaf, start=start: np.asarray(leaf)[: rows - start], result))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *results)


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
