"""The result of many runs."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..trajectory import Trajectory


class Ensemble(eqx.Module):
    """Many runs, with the runs as leading axis.

    - ``trajectory``: as ``jax.vmap`` of :func:`jaxball.simulate` gives it.
    - ``reductions``: what was asked for of each run, by name.
    - ``executed``: the steps of all lanes, idle ones among them.
    """

    trajectory: Trajectory[Any, Any]
    reductions: dict[str, Float[Array | np.ndarray, " runs"]]
    executed: Int[Array | np.ndarray, ""]

    @property
    def efficiency(self) -> Float[Array, ""]:
        """The share of the executed steps that belong to a run."""
        return jnp.sum(self.trajectory.steps) / self.executed
