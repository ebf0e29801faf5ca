"""Graphs over time: of a body or two their components, of more bodies one curve for each."""

from collections.abc import Iterable
from typing import Any

from ..palette import COMPONENTS, mass_colour
from .scene import SUBSCRIPTS

PAIR = 2
BLUE, RED, YELLOW = COMPONENTS


def graph(title: str, series: list[dict[str, Any]]) -> dict[str, Any]:
    """A graph of series."""
    return {"title": title, "series": series}


def series(name: str, colour: str | None, array: str, columns: list[int], norm: bool = False) -> dict[str, Any]:
    """The sum of ``columns`` of an array, or their norm; in the colour of the body, where there is no other."""
    return {"name": name.translate(SUBSCRIPTS), "colour": colour, "array": array, "columns": columns, "norm": norm}


def each(names: Iterable[str], colours: Iterable[str], array: str) -> list[dict[str, Any]]:
    """A series of each column."""
    return [series(name, colour, array, [k]) for k, (name, colour) in enumerate(zip(names, colours, strict=False))]


def angular_velocity(count: int) -> dict[str, Any]:
    """Ω of one body or two, |Ω| of more."""
    if count > PAIR:
        return graph("Angular speed", [series("|Ω|", None, "angular_velocity", [0, 1, 2], norm=True)])
    return graph("Angular velocity", each(("Ω1", "Ω2", "Ω3"), COMPONENTS, "angular_velocity"))


def energies(count: int) -> dict[str, Any]:
    """T, V and their sum of one body or two, the sum of more."""
    if count > PAIR:
        return graph("Energy", [series("E", None, "energies", [0, 1])])
    parts = (("T", BLUE, [0]), ("V", RED, [1]), ("E", YELLOW, [0, 1]))
    return graph("Energies", [series(name, colour, "energies", columns) for name, colour, columns in parts])


def taken() -> list[dict[str, Any]]:
    """What friction of sliding and impacts have taken, beside the energies."""
    names = ("to friction", "to impacts")
    return [series(name, mass_colour(3), "taken", [k]) | {"dashed": bool(k)} for k, name in enumerate(names)]


def laws(names: list[str]) -> list[dict[str, Any]]:
    """How far each law is from where it began, if there are any; those of one system."""
    colours = map(mass_colour, range(1, len(names) + 1))
    if not names:
        return []
    return [graph("Laws, change since the start", each(names, colours, "laws")) | {"valued": False}]
