"""The cost of the actuation, and the distance of the masses."""

import jax.numpy as jnp

from ..run import Run
from .base import AbstractRunningObjective, unit_of_time


class AccelerationEffort(AbstractRunningObjective):
    """The mean of Σ θ̈² over the masses on rails, in units of g²/r², as in the authors' papers on control.

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    def integrand(self, run: Run):
        return jnp.sum(run.on_rails.thetaddot**2, axis=-1) * unit_of_time(run) ** 4


class PowerEffort(AbstractRunningObjective):
    """The mean of Σ P² over the masses, P = F·χ̇ the power of a mass's actuator, in units of M g √(g r).

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    def integrand(self, run: Run):
        power = jnp.sum(run.forces * run.masses.chidot, axis=-1)
        unit = run.weight * run.length / unit_of_time(run)
        return jnp.sum(power**2, axis=-1) / unit**2


class ForceEffort(AbstractRunningObjective):
    """The mean of Σ (F·τ)² over the masses, F·τ the force on a mass along its rail, in units of M g.

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    def integrand(self, run: Run):
        return jnp.sum(run.forces_along**2, axis=-1) / run.weight**2


class JointEffort(AbstractRunningObjective):
    """The mean of Σ Q² over the joints of mechanisms, a torque in units of M g r and a force in units of M g.

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    def integrand(self, run: Run):
        return jnp.sum((run.joint_efforts / run.effort_units[None]) ** 2, axis=-1)


class MassesNearCentre(AbstractRunningObjective):
    """The mean of Σ |χ|² / r² over the point masses: it keeps them from the ends of straight tubes.

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    def integrand(self, run: Run):
        return jnp.sum(run.masses.chi**2, axis=(-2, -1)) / run.length**2
