"""What a sensor is."""

import abc
from collections.abc import Mapping
from typing import Any, ClassVar

from jaxtyping import Array, Float

from ..interface.arguments import refusal, require
from ..interface.printing import Printed
from ..interface.wording import did_you_mean
from ..physics.body import AbstractBody
from ..physics.observables import Movement


class AbstractSensor(Printed):
    """Something that reads the motion of a ball or a disk at one moment.

    A kind of sensor implements ``reading``, and ``places`` where its field ``on`` names what it is on. ``units`` and
    ``meaning`` say in files and figures what it reads.
    """

    units: ClassVar[str] = ""
    meaning: ClassVar[str] = "reading of a sensor"

    @abc.abstractmethod
    def reading(self, system: AbstractBody, t: Float[Array, ""], movement: Movement) -> Float[Array, "..."]:
        """What it reads of a body that moves so; ``system`` is prepared."""

    @classmethod
    def places(cls, system: AbstractBody) -> tuple[str, ...]:
        """What of a body it can be on, by name."""
        return ()

    def require_on(self, system: AbstractBody, name: str) -> None:
        """Raises a ``ValueError`` unless the body has what it is on; ``name`` is what the sensor is called."""
        on = getattr(self, "on", None)
        places = self.places(system)
        if on is None or on in places:
            return
        known = f"it can be on {', '.join(places)}" if places else "there is nothing that it can be on"
        raise ValueError(
            f"Argument `{name}.on` must be a part of this {system.title}, but it is {on!r}"
            f"{did_you_mean(on, places, known)}"
        )


def require_sensors(sensors: Any, system: Any) -> None:
    """Raises unless the argument ``sensors`` holds sensors by name that a body can have.

    **Raises:** ``TypeError`` for anything else, ``ValueError`` where the body does not have what one is on.
    """
    if not isinstance(sensors, Mapping):
        raise refusal("sensors", 'a dictionary of sensors by name, such as {"gyro": Gyroscope()}', sensors)
    for name, sensor in sensors.items():
        require(f"sensors[{name!r}]", sensor, AbstractSensor, "a sensor, such as Accelerometer(...)")
        sensor.require_on(system, f"sensors[{name!r}]")
