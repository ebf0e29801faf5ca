"""Sensors on a mount, accelerometers, gyroscopes and the position that a camera sees, and those of what moves inside.

Encoders and tachometers read joints, and masses on rails.
"""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ...interface.arguments import require
from ...numerics.declare import LENGTH, number
from ...numerics.vectors import apply
from ..body import AbstractBody
from ..dynamics.footing import place_of_centre
from ..dynamics.load import accelerations_of_masses
from ..dynamics.moments import rates_of_mass
from ..observables import Movement
from ..prescribed.frames import AbstractFrame, MatrixFrame
from ..prescribed.motion import Kinematics
from .base import AbstractSensor, Mount, joint_rates, mount, mounts, parts


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

    - ``on``: the joint, or the mass on a rail, such as ``"mechanisms[0].joints[1]"`` or ``"masses[2]"``.

    **Example:**

    >>> from jaxball import ConstantRate, Disk, planar_pendulum, simulate
    >>> from jaxball.physics.sensors import Encoder, Tachometer
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


class _OnMount(AbstractSensor):
    """A sensor on the shell, a link or a mass."""

    @classmethod
    def places(cls, system: AbstractBody) -> tuple[str, ...]:
        return mounts(system)


def _require_mount(on: str | None, *frames: AbstractFrame) -> None:
    require("on", on, (str, type(None)), 'the name of a link or a mass, such as "mechanisms[0].joints[0]", or None')
    for frame in frames:
        require("frame", frame, AbstractFrame, "a frame, such as VersorFrame(...)")


def _in_axes(frame: AbstractFrame, on: Mount, vector: Float[Array, "3"]) -> Float[Array, "3"]:
    """Converts a vector from the body's axes to those of a sensor."""
    # First out of the link's axes, then out of the sensor's own.
    return apply(frame.matrix().T, apply(on.turn.T, vector))


class Accelerometer(_OnMount):
    """The specific force at a mount, its acceleration minus that of gravity, in the axes of the sensor.

    At rest on a level plane it is g upwards, and at the centre of mass of a falling body it is 0. The acceleration is
    that in space, so it includes the motion of the plane, slipping and flight. An impact, which takes no time, is not
    read.

    **Arguments:**

    - ``at``: its position from the geometric centre, in body axes, where every θ is 0, and on a mass from the mass,
      length, shape (3,).
    - ``on``: what it is mounted on, the link moved by ``"mechanisms[0].joints[1]"``, or the mass ``"masses[2]"`` or
      ``"mechanisms[0].masses[1]"``; the shell if not given.
    - ``frame``: the axes of the sensor relative to its mount; those of the mount if not given. Such as a
      :class:`~jaxball.SphericalFrame`.

    **Example:**

    >>> from jaxball import Ball, Ground, simulate
    >>> from jaxball.physics.sensors import Accelerometer
    >>> slope = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), ground=Ground(angle=0.1))
    >>> run = simulate(slope, [0.0, 1.0])
    >>> run.measured({"centre": Accelerometer()})["centre"][0].round(6)  # (−2/7 g sin a, 0, g cos a) where it starts
    Array([-0.028524,  0.      ,  0.995004], dtype=float64)
    """

    at: Float[Array, "3"] = eqx.field(converter=number(LENGTH), default=(0.0, 0.0, 0.0))
    on: str | None = eqx.field(static=True, default=None)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    units: ClassVar[str] = "length/time^2"
    meaning: ClassVar[str] = "specific force in the axes of the sensor"

    def __check_init__(self):
        _require_mount(self.on, self.frame)

    def reading(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> Float[Array, "3"]:
        on = mount(system, t, movement.angles, self.on, self.at)
        point = Kinematics(*(x[None] for x in on.point))
        state = movement.state
        arm = movement.acting.arm.along
        a = accelerations_of_masses(system.radius, point, state.Omega, movement.Omegadot, arm)[0]
        # `weight` is −g: a sensor at rest reads what holds it up.
        return _in_axes(self.frame, on, a + movement.weight)


class Gyroscope(_OnMount):
    """The angular velocity in space of its mount, in the axes of the sensor.

    **Arguments:**

    - ``on``, ``frame``: as for an :class:`Accelerometer`; its position on a link does not matter.

    **Example:**

    >>> from jaxball import Ball, BallState, ConstantRate, planar_pendulum, simulate
    >>> from jaxball.physics.sensors import Gyroscope
    >>> arm = planar_pendulum(0.5, 0.6, drive=ConstantRate(0.0, rate=2.0))
    >>> ball = Ball(mass=1.0, inertia=(0.4, 0.4, 0.4), mechanisms=[arm])
    >>> run = simulate(ball, [0.0, 1.0], BallState(Omega=(0.0, 1.0, 0.0)))
    >>> run.measured({"arm": Gyroscope(on="mechanisms[0].joints[0]")})["arm"][0]  # Ω₂ + θ̇
    Array([0., 3., 0.], dtype=float64)
    """

    on: str | None = eqx.field(static=True, default=None)
    frame: AbstractFrame = eqx.field(default_factory=MatrixFrame)

    units: ClassVar[str] = "rad/time"
    meaning: ClassVar[str] = "angular velocity in the axes of the sensor"

    def __check_init__(self):
        _require_mount(self.on, self.frame)

    def reading(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> Float[Array, "3"]:
        Omega = movement.state.Omega
        # A point at the centre, of the type of the state; any other would do on a rigid part.
        on = mount(system, t, movement.angles, self.on, 0.0 * Omega)
        return _in_axes(self.frame, on, Omega + on.rate)


class Position(_OnMount):
    """The position of a mount relative to the plane, (z₁, z₂) and the height above that of a rolling body's centre.

    It is what a camera over the plane measures of a marker.

    **Arguments:**

    - ``at``, ``on``: as for an :class:`Accelerometer`; by default the geometric centre.

    **Example:**

    >>> from jaxball import Ball, BallState, simulate
    >>> from jaxball.physics.sensors import Position
    >>> rolling = BallState(Omega=(0.0, 1.0, 0.0))
    >>> run = simulate(Ball(mass=1.0, inertia=(0.4, 0.4, 0.4)), [0.0, 2.0], rolling)
    >>> run.measured({"seen": Position(at=(0.0, 0.5, 0.0))})["seen"]
    Array([[0. , 0.5, 0. ],
           [2. , 0.5, 0. ]], dtype=float64)
    """

    at: Float[Array, "3"] = eqx.field(converter=number(LENGTH), default=(0.0, 0.0, 0.0))
    on: str | None = eqx.field(static=True, default=None)

    units: ClassVar[str] = "length"
    meaning: ClassVar[str] = "position relative to the plane"

    def __check_init__(self):
        _require_mount(self.on)

    def reading(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> Float[Array, "3"]:
        chi = mount(system, t, movement.angles, self.on, self.at).point.chi
        state, height = movement.state, None if movement.slip is None else movement.slip.height
        return place_of_centre(system, state, movement.acting.footing, height) + apply(state.Lambda, chi)
