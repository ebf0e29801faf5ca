"""The result of many runs."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..interface.printing import Printed, shown
from ..interface.status import Status
from ..numerics.arrays import is_traced
from ..physics.contact.body_on_plane import ContactHistory
from ..simulation.trajectory import Trajectory


class Ensemble(Printed):
    """Many runs, with the runs as leading axis; ``ensemble[k]`` is the trajectory of run k.

    - ``trajectory``: as ``jax.vmap`` of :func:`jaxball.simulate` gives it.
    - ``reductions``: the results of reductions for each run, by name.
    - ``executed``: the steps of all lanes, including idle ones.
    - ``system``, ``times``, ``state``, ``reached``, ``status``, ``steps``, ``rejected``, ``start``, ``contact``: those
      of ``trajectory``.
    """

    trajectory: Trajectory[Any, Any]
    reductions: dict[str, Float[Array | np.ndarray, " runs"]]
    executed: Int[Array | np.ndarray, ""]

    def __repr__(self) -> str:
        lines = [repr(self.trajectory)]
        for name, values in self.reductions.items():
            if is_traced(values):
                lines.append(f"  {name} {shown(values)}")
                continue
            finite = np.asarray(values)[np.isfinite(values)]
            span = f"from {np.min(finite):.6g} to {np.max(finite):.6g}" if finite.size else "not finite in any run"
            lines.append(f"  {name} {span}")
        return "\n".join(lines)

    def __len__(self) -> int:
        return len(self.trajectory.status)

    def __getitem__(self, run: int) -> Trajectory[Any, Any]:
        """The trajectory of one run, with its ``observables``, ``plot()`` and so on."""
        return jax.tree.map(lambda leaf: jnp.asarray(leaf[run]), self.trajectory)

    @property
    def system(self) -> Any:
        return self.trajectory.system

    @property
    def times(self) -> Float[Array | np.ndarray, "runs T"]:
        return self.trajectory.times

    @property
    def state(self) -> Any:
        return self.trajectory.state

    @property
    def reached(self) -> Float[Array, " runs"]:
        return self.trajectory.reached

    @property
    def status(self) -> Int[Array, " runs"]:
        return self.trajectory.status

    @property
    def steps(self) -> Int[Array, " runs"]:
        return self.trajectory.steps

    @property
    def rejected(self) -> Int[Array, " runs"]:
        return self.trajectory.rejected

    @property
    def start(self) -> Any:
        return self.trajectory.start

    @property
    def contact(self) -> ContactHistory | None:
        return self.trajectory.contact

    @property
    def ok(self) -> Bool[Array, " runs"]:
        """Whether each solve reached its end, or a terminal event."""
        return (self.status == Status.SUCCESS) | (self.status == Status.EVENT)

    @property
    def efficiency(self) -> Float[Array, ""]:
        """The share of the executed steps that belong to a run."""
        return jnp.sum(self.trajectory.steps) / self.executed
