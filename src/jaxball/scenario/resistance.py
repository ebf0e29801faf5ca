"""The resistance to rolling of a scenario file."""

from typing import Any

from ..physics.resistance import SMOOTHING, AbstractResistance, Resistance
from .own import Open, names_own, read_own
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
RESISTANCES = Open(AbstractResistance, {"": RESISTANCE})


def read_resistance(values: Any, path: str) -> AbstractResistance:
    """The coefficients of resistance, or a user's class."""
    if names_own(values):
        return read_own(values, path, RESISTANCES)
    resistance = RESISTANCE.read(values, path)
    require_conditions(resistance)
    return resistance
