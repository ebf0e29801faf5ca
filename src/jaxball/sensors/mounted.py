"""Sensors on a mount: accelerometers, gyroscopes, and the position that a camera sees."""

from typing import ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from ..interface.arguments import require
from ..numerics.declare import LENGTH, number
from ..numerics.vectors import apply
from ..physics.body import AbstractBody
from ..physics.dynamics.energy import accelerations_of_masses
from ..physics.dynamics.footing import place_of_centre
from ..physics.observables import Movement
from ..physics.prescribed.frames import AbstractFrame, MatrixFrame
from ..physics.prescribed.motion import Kinematics
from .base import AbstractSensor, Mount, mount, mounts


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

    - ``at``: its position, length, shape (3,): on the shell or a link, from the geometric centre, in body axes, where
      every θ is 0; on a mass, from the mass.
    - ``on``: what it is mounted on: the link moved by ``"mechanisms[0].joints[1]"``, the mass ``"masses[2]"`` or
      ``"mechanisms[0].masses[1]"``, or None for the shell.
    - ``frame``: the axes of the sensor relative to its mount, such as a :class:`~jaxball.SphericalFrame`.

    **Example:**

    >>> from jaxball import Ball, Ground, simulate
    >>> from jaxball.sensors import Accelerometer
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
    >>> from jaxball.sensors import Gyroscope
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
    >>> from jaxball.sensors import Position
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
