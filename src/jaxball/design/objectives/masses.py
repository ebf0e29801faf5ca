"""Where the masses are in the ball."""

import jax.numpy as jnp

from ..run import Run
from .base import AbstractRunningObjective


class MassesNearCentre(AbstractRunningObjective):
    """The mean of Σ |χ|² / r² over the point masses: it keeps them from the ends of straight tubes.

    **Arguments:**

    - ``weight``: by what it is multiplied in the sum of objectives.
    """

    def integrand(self, run: Run):
        return jnp.sum(run.masses.chi**2, axis=(-2, -1)) / run.length**2
