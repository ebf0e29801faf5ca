"""Sensors of joints, and of masses on rails: encoders and tachometers."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ..interface.arguments import require
from ..physics.body import AbstractBody
from ..physics.dynamics.rails import rates_of_mass
from ..physics.observables import Movement
from .base import AbstractSensor, joint_rates, parts


class _OfJoint(AbstractSensor):
    """A sensor of a joint."""

    on: str = eqx.field(static=True)

    def __check_init__(self):
        require("on", self.on, str, 'the name of a joint or a mass, such as "mechanisms[0].joints[0]"')

    @classmethod
    def places(cls, system: AbstractBody) -> tuple[str, ...]:
        joints = [(j, a) for j, mechanism in enumerate(system.mechanisms) for a in range(mechanism.n_joints)]
        # Masses that are not on rails have no θ.
        return (*(f"masses[{i}]" for i in system.on_rails), *(f"mechanisms[{j}].joints[{a}]" for j, a in joints))

    def _rates(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> tuple[Float[Array, ""], ...]:
        """Returns θ, θ̇ and θ̈ of the sensor's joint or mass."""
        kind, index, _, number = parts(self.on)
        if kind == "mechanisms":
            return tuple(values[number] for values in joint_rates(system, t, movement.angles, index))
        return rates_of_mass(system, t, movement.angles, index)


class Encoder(_OfJoint):
    """θ of a joint of a mechanism, or of a mass on a rail.

    **Arguments:**

    - ``on``: the joint or mass, such as ``"mechanisms[0].joints[1]"`` or ``"masses[2]"``.

    **Example:**

    >>> from jaxball import ConstantRate, Disk, planar_pendulum, simulate
    >>> from jaxball.sensors import Encoder, Tachometer
    >>> arm = planar_pendulum(0.5, 0.6, drive=ConstantRate(0.1, rate=2.0))
    >>> run = simulate(Disk(mass=1.0, inertia=0.5, mechanisms=[arm]), [0.0, 1.0])
    >>> joint = "mechanisms[0].joints[0]"
    >>> run.measured({"angle": Encoder(joint), "rate": Tachometer(joint)})
    {'angle': Array([0.1, 2.1], dtype=float64), 'rate': Array([2., 2.], dtype=float64)}
    """

    units: ClassVar[str] = "rad or length"
    meaning: ClassVar[str] = "parameter of a joint, or of a mass on its rail"

    def reading(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> Float[Array, ""]:
        return self._rates(system, t, movement)[0]


class Tachometer(_OfJoint):
    """θ̇ of a joint of a mechanism, or of a mass on a rail.

    **Arguments:**

    - ``on``: as for an :class:`Encoder`, which has an example.
    """

    units: ClassVar[str] = "rad or length / time"
    meaning: ClassVar[str] = "rate of a joint, or of a mass on its rail"

    def reading(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> Float[Array, ""]:
        return self._rates(system, t, movement)[1]
