"""Finds the dimension of a number in a file by its path, from its key and, where that leaves it open, from its joint.

A hinge has an angle where a slider has a length; so do masses on rails and in tubes. Studies and designs state the
units of their numbers by it, and the units of logs are checked.
"""

import re
from collections.abc import Mapping
from typing import Any

from ..numerics.declare import ACCELERATION, EFFORT, Dimension
from .errors import ScenarioError, describe
from .logs import KIND as LOG
from .paths import key_of, steps, value_at
from .units import Units, parse_unit
from .values import Numbers

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
    """Writes a dimension in the words that :meth:`~jaxball.scenario.Units.of` reads; empty if there is none."""
    if dimension is None:
        return ""
    powers = {"mass": dimension.mass, "length": dimension.length, "time": dimension.time}
    above = [name if power == 1 else f"{name}^{power}" for name, power in powers.items() if power > 0]
    below = [name if power == -1 else f"{name}^{-power}" for name, power in powers.items() if power < 0]
    return "/".join(["*".join(above) or ("rad" if dimension.coordinate == 1 else "1"), *below])


def dimension_of(path: str, kinds: Mapping[str, Numbers], document: Mapping[str, Any]) -> str:
    """Returns the dimension of the number at ``path`` in words; empty where it is not declared, or an angle or a
    length.

    - ``kinds``: those of :func:`~jaxball.scenario.values.kinds_of_numbers` while the ``document`` was read.
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
    _check_logs(document, units, "", document)


def _check_logs(value: Any, units: Units | None, path: str, document: Mapping[str, Any]) -> None:
    if isinstance(value, list):
        for k, item in enumerate(value):
            _check_logs(item, units, f"{path}[{k}]", document)
        return
    if not isinstance(value, Mapping):
        return
    if value.get("kind") != LOG or not isinstance(value.get("unit"), str):
        for name, item in value.items():
            _check_logs(item, units, f"{path}.{name}" if path else name, document)
        return
    key, unit = f"{path}.unit", value["unit"]
    if units is None:
        raise ScenarioError(
            f"Key `{key}` must be left out, or `units` must state those of the scenario, with which it is compared."
        )
    unit_choices = [units.of(words) for words in _dimensions_of_log(path, document)]
    if parse_unit(unit, units) not in [parse_unit(choice, units) for choice in unit_choices]:
        raise ScenarioError(
            f"Key `{key}` must be {' or '.join(map(describe, unit_choices))}, because nothing is converted, but it is "
            f"{describe(unit)}; convert the column."
        )


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
