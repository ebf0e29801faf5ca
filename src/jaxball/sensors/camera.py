"""A sensor that sees the body from outside."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interface.arguments import require
from ..numerics.arrays import numbers
from ..numerics.vectors import apply
from ..physics.body import AbstractBody
from ..physics.observables import Movement
from .base import AbstractSensor, mount, mounts


class Position(AbstractSensor):
    """The position of a mount relative to the plane, (z₁, z₂) and the height above that of a rolling body's centre.

    It is what a camera over the plane measures of a marker.

    **Arguments:**

    - ``at``, ``on``: as for an :class:`Accelerometer`; by default the geometric centre.

    **Example:**

    >>> from jaxball import Ball, BallState, simulate
    >>> from jaxball.sensors import Position
    >>> rolling = BallState(Omega=(0.0, 1.0, 0.0))
    >>> run = simulate(Ball(mass=1.0, inertia=(0.4, 0.4, 0.4)), [0.0, 2.0], rolling)
    >>> run.measured({"seen": Position(at=(0.0, 0.5, 0.0))})["seen"]
    Array([[0. , 0.5, 0. ],
           [2. , 0.5, 0. ]], dtype=float64)
    """

    at: Float[Array, "3"] = eqx.field(converter=numbers("at", (3,)), default=(0.0, 0.0, 0.0))
    on: str | None = eqx.field(static=True, default=None)

    units: ClassVar[str] = "length"
    meaning: ClassVar[str] = "position relative to the plane"

    def __check_init__(self):
        require("on", self.on, (str, type(None)), 'the name of a link or a mass, such as "masses[0]", or None')

    @classmethod
    def places(cls, system: AbstractBody) -> tuple[str, ...]:
        return mounts(system)

    def reading(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> Float[Array, "3"]:
        chi = mount(system, t, movement.angles, self.on, self.at).point.chi
        height = jnp.zeros_like(t) if movement.slip is None else movement.slip.height
        state = movement.state
        under = movement.acting.footing
        centre = jnp.append(state.z, height) if under is None else under.centre
        return centre + apply(state.Lambda, chi)
