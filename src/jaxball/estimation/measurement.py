"""What several sensors read of a state at one moment, as one vector."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..interface.printing import Printed
from ..numerics.arrays import is_traced
from ..physics.body import System
from ..physics.observables import movement
from ..physics.state import PlacedState, RotationState
from ..sensors import AbstractSensor
from ..sensors.base import require_sensors


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
