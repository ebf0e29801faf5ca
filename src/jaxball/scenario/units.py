"""The units of a scenario's numbers, and those of all that a run makes of them.

Nothing is converted: the units say what the numbers are. A file may state them in the table ``[units]``.
"""

import re
from dataclasses import dataclass
from typing import Any

from .errors import describe, key_error
from .table import Key, read_table, write_table
from .values import Choice, Nested

DIMENSIONLESS = "dimensionless"
# Exponents of mass, length and time.
DIMENSIONS: dict[str, tuple[int, int, int]] = {
    "1": (0, 0, 0),
    "rad": (0, 0, 0),
    "length": (0, 1, 0),
    "mass": (1, 0, 0),
    "time": (0, 0, 1),
    "momentum": (1, 1, -1),
    "angular momentum": (1, 2, -1),
    "force": (1, 1, -2),
    "torque": (1, 2, -2),
    "energy": (1, 2, -2),
    "power": (1, 2, -3),
}
FACTOR = re.compile(r"(^|[*/])([^*/]+)")
NAMES_OF_SI = {"force": "N", "torque": "N m", "energy": "J", "power": "W"}


@dataclass(frozen=True)
class NameOfUnit:
    """The name of one unit, without powers or numbers, such as ``"m"``."""

    words: str = 'the name of a unit, such as "m", "kg" or "s"'

    def read(self, value: Any, path: str) -> str:
        if not isinstance(value, str) or not re.fullmatch(r"[^\W\d_]+", value):
            raise key_error(path, self.words, describe(value))
        return value

    def write(self, value: Any, path: str) -> str:
        return value


UNITS = {"length": Key(NameOfUnit()), "mass": Key(NameOfUnit()), "time": Key(NameOfUnit())}


@dataclass(frozen=True)
class Units:
    """The units in which the numbers of a scenario are, by their names; all empty for dimensionless numbers.

    - ``length``, ``mass``, ``time``: such as ``"m"``, ``"kg"`` and ``"s"``.

    **Example:**

    >>> from jaxball.scenario import Units
    >>> si = Units("m", "kg", "s")
    >>> si.of("force"), si.of("length/time"), si.of("angular momentum^2")
    ('N', 'm s^-1', 'kg^2 m^4 s^-2')
    """

    length: str = ""
    mass: str = ""
    time: str = ""

    def __str__(self) -> str:
        return DIMENSIONLESS if self.is_dimensionless else f"{self.length}, {self.mass}, {self.time}"

    @property
    def is_dimensionless(self) -> bool:
        """Whether the numbers are dimensionless."""
        return not self.length

    @property
    def is_si(self) -> bool:
        """Whether they are metres, kilograms and seconds."""
        return (self.length, self.mass, self.time) == ("m", "kg", "s")

    def of(self, dimension: str) -> str:
        """Returns the unit of a variable, as UDUNITS and pint read it, by its dimension in words such as
        ``"length/time^2"``.

        It is empty where the words name two dimensions, such as those of an angle or a place, and where they are empty.
        Other words, such as those of a sensor of your own, are returned as they are.
        """
        if not dimension or " or " in dimension:
            return ""
        factors = [(sign, *factor.strip().partition("^")[::2]) for sign, factor in FACTOR.findall(dimension)]
        if any(word not in DIMENSIONS for _, word, _ in factors):
            return dimension
        if self.is_si and dimension in NAMES_OF_SI:
            return NAMES_OF_SI[dimension]
        exponents, angle = [0, 0, 0], False
        for sign, word, power in factors:
            for k, exponent in enumerate(DIMENSIONS[word]):
                exponents[k] += (-1 if sign == "/" else 1) * int(power or 1) * exponent
            angle |= word == "rad"
        names = [] if self.is_dimensionless else zip((self.mass, self.length, self.time), exponents, strict=True)
        powers = [name if exponent == 1 else f"{name}^{exponent}" for name, exponent in names if exponent]
        return " ".join(["rad"] * angle + powers) or "1"


def parse_unit(text: str, units: Units) -> dict[str, int] | None:
    """Parses the power of each unit in a product such as ``"N m"`` or ``"kg m^2 s^-2"``; None for anything else.

    Names of SI stand for their products where that is what ``units`` are.
    """
    powers: dict[str, int] = {}
    for factor in [] if text == "1" else text.replace("*", " ").split():
        parts = re.fullmatch(r"([^\W\d_]+)(?:\^(-?\d+))?", factor)
        if parts is None:
            return None
        dimension = next((words for words, name in NAMES_OF_SI.items() if name == parts[1]), None)
        if units.is_si and dimension is not None:
            names = dict(zip((units.mass, units.length, units.time), DIMENSIONS[dimension], strict=True))
        else:
            names = {parts[1]: 1}
        for name, power in names.items():
            powers[name] = powers.get(name, 0) + power * int(parts[2] or 1)
    return {name: power for name, power in powers.items() if power}


def read_units(value: Any, path: str = "units") -> Units:
    """Reads the value of the key ``units``.

    **Raises:** :class:`~jaxball.scenario.ScenarioError` for anything but a table with three names or that word.
    """
    if value == DIMENSIONLESS:
        return Units()
    if not isinstance(value, dict):
        raise key_error(path, WORDS, describe(value))
    return Units(**read_table(value, path, UNITS))


def write_units(units: Units | None) -> Any:
    """Returns the value of the key ``units``; an empty table if it is left out."""
    if units is None:
        return {}
    return DIMENSIONLESS if units.is_dimensionless else write_table(vars(units), "units", UNITS)


WORDS = f'a table with length, mass and time, or "{DIMENSIONLESS}"'
UNITS_KEY = Key(
    Nested(read_units, lambda value, path: value, WORDS, {"": UNITS}, others=(Choice((DIMENSIONLESS,)),)), None
)
