"""The resistance to rolling of a scenario file."""

from typing import Any

from ..physics.resistance import SMOOTHING, Resistance
from .table import Key, Module
from .traced import require_conditions
from .values import RATE, Flag, Numbers

_NONE = Key(Numbers(), 0.0)
RESISTANCE = Module(
    Resistance,
    {
        "rolling": _NONE,
        "spinning": _NONE,
        "drag": _NONE,
        "rotational_drag": _NONE,
        "dry": Key(Numbers(), None),
        "smoothing": Key(Numbers(dimension=RATE), SMOOTHING),
        "negative": Key(Flag(), False),
    },
)


def read_resistance(values: Any, path: str) -> Resistance:
    """The coefficients of resistance."""
    resistance = RESISTANCE.read(values, path)
    require_conditions(resistance)
    return resistance
