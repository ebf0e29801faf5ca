"""What all sensors share: their contract, where they are mounted, and the readings of several as one vector.

Kinds of sensors derive from ``AbstractSensor``; filters, environments and scenario files read several by a
``Measurement``.

A sensor is on the shell, on a link of a mechanism or on a mass. A position on a link is given like those of joints and
carried masses: from the geometric centre, in body axes, where every θ is 0. A position on a mass is given from the
mass. The axes are those of the body where every θ is 0, and turn with the link; a mass on a rail, or of a mechanism
given by a function, has no axes of its own and keeps those of the body.
"""

import abc
import re
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..compat import is_traced
from ..interface.arguments import refusal, require
from ..interface.printing import Printed
from ..interface.wording import did_you_mean
from ..numerics.calculus import two_derivatives
from ..physics.body import AbstractBody, System
from ..physics.dynamics.moments import kinematics
from ..physics.mechanisms import Mechanism
from ..physics.mechanisms.mechanism import EachJoint
from ..physics.observables import Movement, movement
from ..physics.prescribed.motion import Kinematics
from ..physics.state import PlacedState, Rates, RotationState
from .errors import SensorErrors

_ON = re.compile(r"(masses|mechanisms)\[(\d+)\](?:\.(joints|masses)\[(\d+)\])?")


class AbstractSensor(Printed):
    """A sensor that reads the motion of a ball or a disk at one moment.

    A kind of sensor implements ``reading``, and ``places`` if its field ``on`` names what it is mounted on. ``units``
    and ``meaning`` describe its reading in files and figures. Every kind takes ``errors``, the
    :class:`SensorErrors` that distinguish what arrives from the exact reading.
    """

    errors: SensorErrors | None = eqx.field(kw_only=True, default=None)

    units: ClassVar[str] = ""
    meaning: ClassVar[str] = "reading of a sensor"

    @abc.abstractmethod
    def reading(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> Float[Array, "..."]:
        """Returns the sensor's reading for this motion of a body; ``system`` is prepared."""

    @classmethod
    def places(cls, system: AbstractBody) -> tuple[str, ...]:
        """Returns the names of the parts of a body that the sensor can be on."""
        return ()

    def require_on(self, system: AbstractBody, name: str) -> None:
        """Raises a ``ValueError`` unless the body has the part that it is on; ``name`` is the name of the sensor."""
        on = getattr(self, "on", None)
        places = self.places(system)
        if on is None or on in places:
            return
        hint = f"it can be on {', '.join(places)}" if places else "there is no part that it can be on"
        raise ValueError(
            f"Argument `{name}.on` must be a part of this {system.title}, but it is {on!r}"
            f"{did_you_mean(on, places, hint)}"
        )


def require_sensors(sensors: Any, system: Any) -> None:
    """Raises unless the argument ``sensors`` has sensors by name that fit the body.

    **Raises:** ``TypeError`` for anything else, ``ValueError`` where the body lacks the part that one is on.
    """
    if not isinstance(sensors, Mapping):
        raise refusal("sensors", 'a dictionary of sensors by name, such as {"gyro": Gyroscope()}', sensors)
    for name, sensor in sensors.items():
        require(f"sensors[{name!r}]", sensor, AbstractSensor, "a sensor, such as Accelerometer(...)")
        must = "a SensorErrors, or None"
        require(f"sensors[{name!r}].errors", sensor.errors, (SensorErrors, type(None)), must)
        sensor.require_on(system, f"sensors[{name!r}]")


class Measurement(Printed):
    """The readings of sensors one after the other, in the order of their names.

    - ``sensors``: by name.
    """

    sensors: dict[str, AbstractSensor]

    def parts(self, system: Any, t: Float[Array, ""], state: Any) -> dict[str, Float[Array, "..."]]:
        """Computes the exact reading of each sensor, of a body or, with its modes, of the system that was solved."""
        prepared = system.prepare()
        moves = movement(prepared, t, state.in_space() if isinstance(state, RotationState) else state)
        return {name: sensor.reading(prepared.shown, t, moves) for name, sensor in self.sensors.items()}

    def __call__(self, system: Any, t: Float[Array, ""], state: Any) -> Float[Array, " m"]:
        """Computes all exact readings; arguments as for :meth:`parts`."""
        return jnp.concatenate([jnp.ravel(part) for part in self.parts(system, t, state).values()])

    def sizes(self, system: System, state: PlacedState) -> dict[str, int]:
        """Counts the components that each sensor reads, in the order of the measurement."""
        parts = jax.eval_shape(lambda s: self.parts(system, jnp.zeros(()), s), state)
        return {name: int(np.prod(parts[name].shape)) for name in self.sensors}


def measurement_of(sensors: Mapping[str, AbstractSensor], system: System) -> Measurement:
    """Returns the measurement of sensors whose noise is known.

    **Raises:** ``TypeError`` for anything but sensors by name; ``ValueError`` for none, for one that does not fit the
    body, and for one without noise.
    """
    require_sensors(sensors, system)
    if not sensors:
        raise ValueError("Argument `sensors` must have one sensor or more, but it is empty.")
    for name, sensor in sensors.items():
        noise = None if sensor.errors is None else sensor.errors.noise
        if noise is None or not (is_traced(noise) or np.asarray(noise) > 0):
            raise ValueError(
                f"Argument `sensors[{name!r}]` must have noise, because a filter weighs readings by it, but it has "
                "none; give it errors=SensorErrors(noise=...)."
            )
    return Measurement(dict(sorted(sensors.items())))  # as JAX orders dictionaries


class Mount(NamedTuple):
    """A mount in the body: the rotation from its axes to those of the body, its rate in the body, and its position."""

    turn: Float[Array, "3 3"]
    rate: Float[Array, "3"]
    point: Kinematics


def mounts(system: AbstractBody) -> tuple[str, ...]:
    """Returns the names of the parts that a mount can be on, besides the shell."""
    names = [f"masses[{index}]" for index in range(system.n_masses)]
    for index, mechanism in enumerate(system.mechanisms):
        joints = range(mechanism.n_joints if isinstance(mechanism, Mechanism) else 0)
        names += [f"mechanisms[{index}].joints[{a}]" for a in joints]
        names += [f"mechanisms[{index}].masses[{i}]" for i in range(mechanism.mass.shape[-1])]
    return tuple(names)


def mount(system: AbstractBody, t: Float[Array, ""], angles: Rates, on: str | None, at: Float[Array, "3"]) -> Mount:
    """Returns the mount at ``at`` on a part of the body, None for the shell; ``angles`` are θ, θ̇ and θ̈ of
    the state.
    """
    still, upright = jnp.zeros_like(at), jnp.eye(3, dtype=at.dtype)
    if on is None:
        return Mount(upright, still, Kinematics(at, still, still))
    kind, index, part, number = parts(on)
    if kind == "masses":
        return Mount(upright, still, _beside(system, t, angles, index, at))
    mechanism = system.mechanisms[index]
    if not isinstance(mechanism, Mechanism):
        before = sum(predecessor.mass.shape[-1] for predecessor in system.mechanisms[:index])
        return Mount(upright, still, _beside(system, t, angles, system.n_masses + before + number, at))
    # A mass of a mechanism is on the link that carries it.
    link = number if part == "joints" else mechanism.carrier[number]
    return _on_link(
        mechanism, joint_rates(system, t, angles, index), link, at if part == "joints" else at + mechanism.place[number]
    )


def parts(on: str) -> tuple[str, int, str, int]:
    """Returns the kind and index of the part that a sensor is on, and the part within a mechanism."""
    match = _ON.fullmatch(on)
    assert match is not None
    kind, index, part, number = match.groups()
    return kind, int(index), part or "", int(number or 0)


def joint_rates(system: AbstractBody, t: Float[Array, ""], angles: Rates, index: int) -> EachJoint:
    """Returns θ, θ̇ and θ̈ of every joint of a mechanism."""
    mechanism = system.mechanisms[index]
    places = system.slots((index,), mechanism.in_state)[0]
    return mechanism.rates(t, (angles[0][places], angles[1][places], angles[2][places]))


def _beside(
    system: AbstractBody, t: Float[Array, ""], angles: Rates, row: int, offset: Float[Array, "3"]
) -> Kinematics:
    """Computes the position in the body, with its rates, of a point at a constant distance from a mass."""
    chi, chidot, chiddot = (values[row] for values in kinematics(system, t, angles))
    return Kinematics(chi + offset, chidot, chiddot)


def _on_link(mechanism: Mechanism, rates: EachJoint, link: int, point: Float[Array, "3"]) -> Mount:
    theta, thetadot, thetaddot = rates

    # A curve with these derivatives at s = 0 gives velocity and acceleration without writing out the chain of joints.
    def place_link(s: Float[Array, ""]) -> Float[Array, "4 3"]:
        """Places the link and the point, along a motion with these rates: a rotation and a position."""
        placement = mechanism.links(theta + s * thetadot + s**2 / 2 * thetaddot)[link].placement
        return jnp.concatenate([placement.turn, placement.of_point(point)[None]])

    place, velocity, acceleration = two_derivatives(place_link, jnp.zeros((), point.dtype))
    turn = place[:3]
    spin = jnp.sum(velocity[:3, None, :] * turn[None, :, :], axis=-1)  # ŵ = Ṙ Rᵀ
    return Mount(
        turn, jnp.stack([spin[2, 1], spin[0, 2], spin[1, 0]]), Kinematics(place[3], velocity[3], acceleration[3])
    )
