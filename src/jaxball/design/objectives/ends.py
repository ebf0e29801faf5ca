"""Objectives about the end of a run."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...numerics.arrays import numbers
from ...numerics.norms import norm
from ...physics.imbalance import imbalance
from ..plane import beside, place
from ..run import Run
from .base import AbstractObjective, unit_of_time


class ReachPlace(AbstractObjective):
    """|z − place|² / r² at the end, the square of the distance.

    **Arguments:**

    - ``place``: length, (z1, z2) for a ball, z for a disk.
    - ``weight``: its factor in the sum of objectives.
    """

    place: Float[Array, "2"] = eqx.field(converter=place("place"))

    def __call__(self, run: Run):
        return jnp.sum((run.z[-1] - self.place) ** 2) / run.length**2

    def in_units(self, value, length, time):
        return f"distance {length * math.sqrt(value):.4g}"

    def beyond_a_disk(self):
        return beside(self.place[None])

    def farthest(self, run: Run) -> Float[Array, ""]:
        """The distance from ``place`` at the end, in radii."""
        return norm(run.z[-1] - self.place) / run.length


class ReachPose(AbstractObjective):
    """sin² of half the angle between the orientation at the end and ``versor``: 1 − (q·q*)² / (|q| |q*|)².

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    versor: Float[Array, "4"] = eqx.field(converter=numbers("versor", (4,)))

    def __call__(self, run: Run):
        q = run.state.in_space().q[-1]
        return 1 - jnp.sum(q * self.versor) ** 2 / (jnp.sum(q**2) * jnp.sum(self.versor**2))

    def in_units(self, value, length, time):
        return f"angle {2 * math.asin(math.sqrt(min(max(value, 0.0), 1.0))):.4g} rad"

    def beyond_a_disk(self):
        return "a turn about another axis" if np.any(np.asarray(self.versor)[[1, 3]] != 0) else ""


class StopAtRest(AbstractObjective):
    """T / (M g r) at the end, the kinetic energy of shell and masses: zero where all are at rest.

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    def __call__(self, run: Run):
        return run.observables.kinetic_energy[-1] / (run.weight * run.length)


class Balanced(AbstractObjective):
    """The squared distance of the centre of mass at the end from where it could rest at the same height, over r².

    On a level plane this is its horizontal distance from the geometric centre, on a slope its distance along the plane
    from the vertical through the contact point.

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    def __call__(self, run: Run):
        end = jax.tree.map(lambda leaf: leaf[-1], run.state)
        beside = imbalance(run.system.prepare(), run.times[-1], end).beside
        return jnp.sum(beside**2) / run.length**2

    def in_units(self, value, length, time):
        return f"horizontal distance {length * math.sqrt(value):.4g}"


class GoFar(AbstractObjective):
    """−|z(end) − z(start)| / r: as far as possible.

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    def __call__(self, run: Run):
        return -norm(run.z[-1] - run.z[0]) / run.length

    def in_units(self, value, length, time):
        return f"distance {-value * length:.4g}"


class Duration(AbstractObjective):
    """The duration of the run, in units of √(r/g), if its end is a variable.

    **Arguments:**

    - ``weight``: its factor in the sum of objectives.
    """

    def __call__(self, run: Run):
        return (run.times[-1] - run.times[0]) / unit_of_time(run)

    def in_units(self, value, length, time):
        return f"time {value * time:.4g}"
