"""The contract of sensors, and what several of them read of a state at one moment, as one vector."""

import abc
from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.arguments import refusal, require
from ..interface.printing import Printed
from ..interface.wording import did_you_mean
from ..numerics.arrays import is_traced
from ..physics.body import AbstractBody, System
from ..physics.observables import Movement, movement
from ..physics.state import PlacedState, RotationState
from .errors import SensorErrors


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
        """Its reading for this motion of a body; ``system`` is prepared."""

    @classmethod
    def places(cls, system: AbstractBody) -> tuple[str, ...]:
        """The parts of a body that it can be on, by name."""
        return ()

    def require_on(self, system: AbstractBody, name: str) -> None:
        """Raises a ``ValueError`` unless the body has the part that it is on; ``name`` is the name of the sensor."""
        on = getattr(self, "on", None)
        places = self.places(system)
        if on is None or on in places:
            return
        known = f"it can be on {', '.join(places)}" if places else "there is no part that it can be on"
        raise ValueError(
            f"Argument `{name}.on` must be a part of this {system.title}, but it is {on!r}"
            f"{did_you_mean(on, places, known)}"
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

    def parts(self, system: System, t: Float[Array, ""], state: PlacedState) -> dict[str, Float[Array, "..."]]:
        """The exact reading of each sensor."""
        prepared = system.prepare()
        moves = movement(prepared, t, state.in_space() if isinstance(state, RotationState) else state)
        return {name: sensor.reading(prepared, t, moves) for name, sensor in self.sensors.items()}

    def __call__(self, system: System, t: Float[Array, ""], state: PlacedState) -> Float[Array, " m"]:
        """All exact readings."""
        return jnp.concatenate([jnp.ravel(part) for part in self.parts(system, t, state).values()])


def measurement_of(sensors: Mapping[str, AbstractSensor], system: System) -> Measurement:
    """The measurement of sensors whose noise is known.

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
