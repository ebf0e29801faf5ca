"""The result of many runs."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from ..interface.printing import Printed, shown
from ..simulation.trajectory import Trajectory


class Ensemble(Printed):
    """Many runs, with the runs as leading axis.

    - ``trajectory``: as ``jax.vmap`` of :func:`jaxball.simulate` gives it.
    - ``reductions``: what was asked for of each run, by name.
    - ``executed``: the steps of all lanes, idle ones among them.
    """

    trajectory: Trajectory[Any, Any]
    reductions: dict[str, Float[Array | np.ndarray, " runs"]]
    executed: Int[Array | np.ndarray, ""]

    def __repr__(self) -> str:
        lines = [repr(self.trajectory)]
        for name, values in self.reductions.items():
            if isinstance(values, Tracer):
                lines.append(f"  {name} {shown(values)}")
                continue
            finite = np.asarray(values)[np.isfinite(values)]
            span = f"from {np.min(finite):.6g} to {np.max(finite):.6g}" if finite.size else "not finite in any run"
            lines.append(f"  {name} {span}")
        return "\n".join(lines)

    @property
    def efficiency(self) -> Float[Array, ""]:
        """The share of the executed steps that belong to a run."""
        return jnp.sum(self.trajectory.steps) / self.executed
