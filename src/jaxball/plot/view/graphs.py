"""Graphs over time: the components for one or two bodies, one curve each for more."""

from collections.abc import Iterable
from typing import Any

from ..palette import COMPONENTS, DASHED, SOLID, TAKEN, Dashes, Line, mass_look
from .scene import SUBSCRIPTS

PAIR = 2
BLUE, RED, YELLOW = COMPONENTS
INK = "ink"  # the colour of text, on light pages and on dark ones
WIDTH = 1.6  # of lines, pixels


def graph(title: str, series: list[dict[str, Any]], size: float = 0.0, *, gaps: bool = False) -> dict[str, Any]:
    """A graph of series, where rounding compared with ``size`` is 0; with ``gaps`` at switches between modes."""
    return {"title": title, "series": series, "size": size, "gaps": gaps}


def series(
    name: str, colour: str | None, array: str, columns: list[int], norm: bool = False, dashes: Dashes = SOLID
) -> dict[str, Any]:
    """The sum of ``columns`` of an array, or their norm; in the colour of the body unless another is given."""
    return {
        "name": name.translate(SUBSCRIPTS),
        "colour": colour,
        "dash": [WIDTH * length for length in dashes],
        "array": array,
        "columns": columns,
        "norm": norm,
    }


def each(names: Iterable[str], looks: Iterable[Line | str], array: str) -> list[dict[str, Any]]:
    """A series for each column, with its colour or its line."""
    lines = [Line(look) if isinstance(look, str) else look for look in looks]
    pairs = enumerate(zip(names, lines, strict=False))
    return [series(name, line.colour, array, [k], dashes=line.dashes) for k, (name, line) in pairs]


def of_masses(numbers: Iterable[int]) -> list[Line]:
    """The lines of masses or joints."""
    return [mass_look(i) for i in numbers]


def rate_of_turning(size: float) -> dict[str, Any]:
    """φ̇ of disks."""
    return graph("Angular velocity", [series("φ̇", BLUE, "turning", [0])], size)


def angular_velocity(count: int, size: float = 0.0) -> dict[str, Any]:
    """Ω of one or two bodies, |Ω| of more."""
    if count > PAIR:
        return graph("Angular speed", [series("|Ω|", None, "angular_velocity", [0, 1, 2], norm=True)], size)
    return graph("Angular velocity", each(("Ω1", "Ω2", "Ω3"), COMPONENTS, "angular_velocity"), size)


def energies(count: int, size: float = 0.0) -> dict[str, Any]:
    """T, V and their sum of one or two bodies, the sum of more."""
    if count > PAIR:
        return graph("Energy", [series("E", None, "energies", [0, 1])], size)
    parts = (("T", BLUE, [0], SOLID), ("V", RED, [1], SOLID), ("E", INK, [0, 1], DASHED))
    lines = [series(name, colour, "energies", columns, dashes=dashes) for name, colour, columns, dashes in parts]
    return graph("Energies", lines, size)


def taken() -> list[dict[str, Any]]:
    """The energy dissipated by sliding friction and impacts, beside the energies."""
    return each(TAKEN, TAKEN.values(), "taken")


def laws(names: list[str]) -> list[dict[str, Any]]:
    """The change of each law since the start, if there are any; for one system."""
    if not names:
        return []
    lines = each(names, of_masses(range(1, len(names) + 1)), "laws")
    return [graph("Laws, change since the start", lines) | {"valued": False}]
