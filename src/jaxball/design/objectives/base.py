"""The contract of objectives."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ..plane import Requirement
from ..run import Run


class AbstractObjective(Requirement):
    """A dimensionless number that a design minimises: lengths in radii r, forces in weights M g, times in √(r/g).

    ``weight`` multiplies it in the sum of objectives; it can change without compiling again.
    """

    weight: Float[Array, ""] = eqx.field(converter=numbers("weight"), default=1.0, kw_only=True)

    @abc.abstractmethod
    def __call__(self, run: Run) -> Float[Array, ""]:
        """Its value, without the weight."""

    def in_units(self, value: float, length: float, time: float) -> str:
        """A value as text, as the length, the angle or the time that it stands for; empty if it is none of them.

        ``length`` and ``time`` are r and √(r/g) in units of the scenario.
        """
        return ""


class AbstractRunningObjective(AbstractObjective):
    """The mean over the run of a function of the time and of the state and the actuation at that time."""

    @abc.abstractmethod
    def integrand(self, run: Run) -> Float[Array, " t"]:
        """The function at the times of the run."""

    def __call__(self, run: Run):
        return mean_in_time(run, self.integrand(run))


def mean_in_time(run: Run, values: Float[Array, " t"]) -> Float[Array, ""]:
    """The mean over the run, by the trapezoidal rule."""
    steps = jnp.diff(run.times)
    return jnp.sum(steps * (values[1:] + values[:-1]) / 2) / jnp.sum(steps)


def unit_of_time(run: Run) -> Float[Array, ""]:
    """√(r/g)."""
    return jnp.sqrt(run.length / jnp.abs(run.system.gravity))
