"""The units of a scenario's numbers, and those of all that a run makes of them.

Nothing is converted: the units say what the numbers are. A file may state them in the table ``[units]``. The dimension
of a number follows from its path, from its key and, where that leaves it open, from its joint: a hinge has an angle
where a slider has a length; so do masses on rails and in tubes. Studies and designs state the units of their numbers by
it, and the units of logs are checked.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...numerics.declare import ACCELERATION, EFFORT, Dimension
from .errors import ScenarioError, describe, key_error
from .logs import KIND as LOG
from .paths import key_of, steps, value_at, walk
from .table import Key, read_table, write_table
from .values import Checked, Choice, Nested, Numbers

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


COMMON_UNITS = {
    "length": ("m", "km", "dm", "cm", "mm", "um", "in", "ft"),
    "mass": ("kg", "t", "g", "mg", "lb"),
    "time": ("s", "ms", "us", "min", "h"),
}


@dataclass(frozen=True)
class NameOfUnit(Checked):
    """The name of one unit, without powers or numbers, such as ``"m"``; any but a common one of another quantity."""

    quantity: str
    words: str = 'the name of a unit, such as "m", "kg" or "s"'

    def fits(self, value: Any) -> bool:
        return isinstance(value, str) and bool(re.fullmatch(r"[^\W\d_]+", value))

    def read(self, value: Any, path: str) -> str:
        for quantity, names in COMMON_UNITS.items():
            if quantity != self.quantity and value in names:
                raise key_error(path, f"a unit of {self.quantity}", f"{describe(value)}, which is one of {quantity}")
        return super().read(value, path)


UNITS = {name: Key(NameOfUnit(name), says=f"the unit of {name}") for name in COMMON_UNITS}


@dataclass(frozen=True)
class Units:
    """The units in which the numbers of a scenario are, by their names; all empty for dimensionless numbers.

    - ``length``, ``mass``, ``time``: such as ``"m"``, ``"kg"`` and ``"s"``.

    **Example:**

    >>> from jaxball.files.scenario import Units
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

    **Raises:** :class:`~jaxball.ScenarioError` for anything but a table with three names or that word.
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
    Nested(read_units, lambda value, path: value, WORDS, {"": UNITS}, others=(Choice((DIMENSIONLESS,)),)),
    None,
    says="the units that the numbers are in; nothing is converted",
)


_PLACE = re.compile(r"mechanisms\[\d+\]\.joints\[\d+\]|masses\[\d+\]|ground\.(?:motion|displacement|belt\.travel)")
# Angles of frames and of sinusoids, in joints of any kind.
_ALWAYS_ANGLES = ("phase", "frequency", "azimuth", "elevation", "angle")
# Lists of polynomials in time, with the place of the degree among the indices of a number.
_POLYNOMIALS = {"accelerations": 1, "values": 1, "powers": 0}
_COORDINATES = {"hinge": "rad", "slider": "length", "tube": "length"}
_RAILS = ("circle", "ellipse", "fourier", "spline", "bernoulli-eight", "gerono-eight")
# What a signal is of, by its key: that of a motor of a force, and that of a law of accelerations.
_OF_SIGNALS = {"signal": EFFORT, "command": Dimension(0, 0), "signals": ACCELERATION}
_EFFORTS = {"rad": ("torque",), "length": ("force",)}
_TURNS = ("turning", "angle", "about_e1", "about_e2")
_EITHER = ("rad", "length")


def dimension_words(dimension: Dimension | None) -> str:
    """Writes a dimension in the words that :meth:`~jaxball.files.scenario.Units.of` reads; empty if there is none."""
    if dimension is None:
        return ""
    powers = {"mass": dimension.mass, "length": dimension.length, "time": dimension.time}
    above = [name if power == 1 else f"{name}^{power}" for name, power in powers.items() if power > 0]
    below = [name if power == -1 else f"{name}^{-power}" for name, power in powers.items() if power < 0]
    return "/".join(["*".join(above) or ("rad" if dimension.coordinate == 1 else "1"), *below])


def dimension_of(path: str, kinds: Mapping[str, Numbers], document: Mapping[str, Any]) -> str:
    """Returns the dimension of the number at ``path`` in words; empty where it is not declared, or an angle or a
    length.

    - ``kinds``: those of :func:`~jaxball.files.scenario.values.kinds_of_numbers` while the ``document`` was read.
    """
    kind = kinds.get(key_of(path))
    names = [step for step in steps(path) if isinstance(step, str)]
    if kind is None or kind.dimension is None:
        return ""
    # A state lists coordinates of all kinds, some of which are angles and some lengths.
    if names[-1] in ("theta", "thetadot") and path.startswith("initial."):
        return ""
    dimension = _of_coefficient(kind.dimension, path, names[-1])
    if names[-1] in _ALWAYS_ANGLES or not dimension.coordinate:
        return dimension_words(dimension)
    of_signal = next((_OF_SIGNALS[name] for name in names[1:] if name in _OF_SIGNALS), None)
    if of_signal is not None and dimension.coordinate == 1:
        dimension = Dimension(*map(sum, zip(dimension._replace(coordinate=0), of_signal, strict=True)))
    place = _PLACE.match(path)
    if not dimension.coordinate or (place is None and of_signal is None):
        return dimension_words(dimension)
    coordinates = _EITHER if place is None else _coordinates_of(place[0], document)
    if coordinates == ("length",):
        dimension = dimension._replace(length=dimension.length + dimension.coordinate, coordinate=0)
    return dimension_words(dimension) if len(coordinates) == 1 else ""


def _of_coefficient(dimension: Dimension, path: str, name: str) -> Dimension:
    """Returns the dimension of a coefficient of a polynomial in time, whose constant one has this ``dimension``."""
    indices = [int(index) for index in re.findall(r"\[(\d+)\]", path[path.rfind(name) :])]
    place = _POLYNOMIALS.get(name)
    if place is None or len(indices) != 2:
        return dimension
    return dimension._replace(time=dimension.time - indices[place])


def check_units_of_logs(document: Mapping[str, Any], units: Units | None) -> None:
    """Raises a :class:`ScenarioError` for the first log whose ``unit`` is not that of its numbers in ``units``."""
    for path, value in walk(document):
        if isinstance(value, Mapping) and value.get("kind") == LOG and isinstance(value.get("unit"), str):
            _check_log(path, value["unit"], units, document)


def _check_log(path: str, unit: str, units: Units | None, document: Mapping[str, Any]) -> None:
    key = f"{path}.unit"
    if units is None:
        raise ScenarioError(
            f"Key `{key}` must be left out, or `units` must state those of the scenario, with which it is compared."
        )
    unit_choices = [units.of(words) for words in _dimensions_of_log(path, document)]
    if parse_unit(unit, units) not in [parse_unit(choice, units) for choice in unit_choices]:
        must = f"{' or '.join(map(describe, unit_choices))}, because nothing is converted"
        raise key_error(key, must, f"{describe(unit)}; convert the column")


def _dimensions_of_log(path: str, document: Mapping[str, Any]) -> tuple[str, ...]:
    """Returns the dimensions that the values of a log may have at a place in the document."""
    name = [step for step in steps(path) if isinstance(step, str)][-1]
    if name in _TURNS:
        return ("rad",)
    if name == "command":
        return ("1",)
    place = _PLACE.match(path)
    coordinates = _EITHER if place is None else _coordinates_of(place[0], document)
    if name == "signals":
        return tuple(f"{coordinate}/time^2" for coordinate in coordinates)
    if name == "signal":
        return tuple(effort for coordinate in coordinates for effort in _EFFORTS[coordinate])
    return coordinates


def _coordinates_of(place: str, document: Mapping[str, Any]) -> tuple[str, ...]:
    """Returns the dimensions that the coordinate of a joint, a belt, or a mass on its rail, may have."""
    if place == "ground.belt.travel":
        return ("length",)
    try:
        item = value_at(document, place)
    except LookupError:
        return _EITHER
    kind = item.get("kind") if isinstance(item, Mapping) else None
    rail = item.get("rail") if isinstance(item, Mapping) else None
    if isinstance(rail, Mapping):
        kind = rail.get("kind")
    if kind in _RAILS:
        return ("rad",)
    return (_COORDINATES[kind],) if kind in _COORDINATES else _EITHER
