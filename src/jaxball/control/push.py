"""Pushes: forces for some time, which disturb a motion."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.arrays import numbers
from ..physics.force import AbstractWrench, BodyMotion, Wrench


class Push(AbstractWrench):
    """A constant force at the geometric centre, and perhaps a torque, from ``start`` for a ``duration``.

    **Arguments:**

    - ``force``: space axes, mass length/time², shape (3,).
    - ``start``: a time.
    - ``duration``: a time; the push gives the momentum force × duration.
    - ``torque``: space axes, mass length²/time², shape (3,); none if not given.

    **Example:**

    >>> import jax.numpy as jnp
    >>> from jaxball import Disk, DiskState, simulate
    >>> from jaxball.control import Push
    >>> disk = Disk(mass=1.0, inertia=0.5, force=Push((0.3, 0.0, 0.0), start=1.0, duration=0.5))
    >>> run = simulate(disk, [0.0, 2.0])
    >>> round(float(run.observables.geometric_centre[-1, 0]), 6)  # 0.3 / (m + d / r²) (½ · 0.5² + 0.5 · 0.5)
    0.075
    """

    force: Float[Array, "*group 3"] = eqx.field(converter=numbers("force", (3,)))
    start: Float[Array, "*group"] = eqx.field(converter=numbers("start"))
    duration: Float[Array, "*group"] = eqx.field(converter=numbers("duration"))
    torque: Float[Array, "*group 3"] = eqx.field(converter=numbers("torque", (3,)), default=(0.0, 0.0, 0.0))

    def wrench(self, t: Float[Array, ""], motion: BodyMotion) -> Wrench:
        lasts = (t >= self.start) & (t < self.start + self.duration)
        return Wrench(jnp.where(lasts, self.force, 0.0), jnp.where(lasts, self.torque, 0.0))

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.stack([self.start, self.start + self.duration])


class Wrenches(AbstractWrench):
    """Several forces at once.

    **Arguments:**

    - ``terms``: the forces.
    """

    terms: tuple[AbstractWrench, ...]

    def wrench(self, t: Float[Array, ""], motion: BodyMotion) -> Wrench:
        each = [term.wrench(t, motion) for term in self.terms]
        torques = [one.torque for one in each if one.torque is not None]
        force, torque = sum((one.force for one in each[1:]), each[0].force), None
        return Wrench(force, sum(torques[1:], torques[0]) if torques else torque)

    def kinks(self) -> Float[Array, " kinks"]:
        return jnp.concatenate([term.kinks() for term in self.terms])
