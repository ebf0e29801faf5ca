"""Which graphs over time a view has: of a run or two their components, of more bodies one curve for each."""

from collections.abc import Iterable, Sequence
from typing import Any

from ..style import COMPONENTS, mass_colour
from .body import SUBSCRIPTS, Shown

PAIR = 2


def graphs_of(bodies: Sequence[Shown]) -> list[dict[str, Any]]:
    """The graphs of bodies, of which each is drawn that has the numbers."""
    ratio = {"title": "Friction needed", "level": "μ"}
    if len(bodies) > PAIR:
        return [
            _graph("Energy", [_series("E", None, "energies", [0, 1])]),
            _graph("Angular speed", [_series("|Ω|", None, "angular_velocity", [0, 1, 2], norm=True)]),
            _graph("Normal force", [_series("N", None, "normal_force", [0])]),
            ratio | {"series": [_ratio(None)]},
        ]
    blue, red, yellow = COMPONENTS
    energies = [
        _series(name, colour, "energies", columns)
        for name, colour, columns in (("T", blue, [0]), ("V", red, [1]), ("E", yellow, [0, 1]))
    ]
    graphs = [
        _graph("Energies", energies),
        _graph("Angular velocity", _each(("Ω1", "Ω2", "Ω3"), COMPONENTS, "angular_velocity")),
        _graph("Normal force", [_series("N", blue, "normal_force", [0])]),
        ratio | {"series": [_ratio(red)]},
    ]
    masses = max((list(one.angles) for one in bodies), key=len)
    if masses:
        names = [f"θ{i}" for i in masses]
        graphs.append(_graph("Angles of the masses", _each(names, map(mass_colour, masses), "mass_angles")))
    joints = max((_joints(one) for one in bodies), key=len)
    if joints:
        colours = map(mass_colour, range(1, len(joints) + 1))
        graphs.append(_graph("Joints", _each(joints, colours, "joint_angles")))
    return graphs


def _joints(one: Shown) -> list[str]:
    mechanisms = enumerate(one.system.mechanisms, start=1)
    return [f"θ{j},{a}" for j, mechanism in mechanisms for a in range(1, mechanism.n_joints + 1)]


def _graph(title: str, series: list[dict[str, Any]]) -> dict[str, Any]:
    return {"title": title, "series": series}


def _series(name: str, colour: str | None, array: str, columns: list[int], norm: bool = False) -> dict[str, Any]:
    """The sum of ``columns`` of an array, or their norm; in the colour of the body, where there is no other."""
    return {"name": name.translate(SUBSCRIPTS), "colour": colour, "array": array, "columns": columns, "norm": norm}


def _ratio(colour: str | None) -> dict[str, Any]:
    return _series("|f| / N", colour, "friction", [0, 1], norm=True) | {"over": "normal_force"}


def _each(names: Iterable[str], colours: Iterable[str], array: str) -> list[dict[str, Any]]:
    """A series of each column."""
    return [_series(name, colour, array, [k]) for k, (name, colour) in enumerate(zip(names, colours, strict=False))]
