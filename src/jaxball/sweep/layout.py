"""How the rows of a study lie along its axes, as attributes from which its store can be drawn."""

from typing import Any

from .axes import Axis, Designed, FromFile, Ranged, Zipped
from .study import Study

_LOGARITHMIC = ("log-uniform", "lognormal")


def layout_of(study: Study) -> dict[str, list[Any]]:
    """For each path, its axis and whether its values are spread by their logarithm; for each axis, whether its points
    are scattered; the names of what the study finds. Lists of numbers and texts, which every file format can hold.
    """
    finds = {"finds": [find.name for find in study.finds]} if study.finds else {}
    return finds | {
        "path_axis": [k for k, axis in enumerate(study.axes) for _ in axis.paths],
        "path_logarithmic": [int(item) for axis in study.axes for item in _logarithmic(axis)],
        "axis_scattered": [int(_scattered(axis)) for axis in study.axes],
    }


def _logarithmic(axis: Axis) -> list[bool]:
    if isinstance(axis, Zipped):
        return [item for member in axis.members for item in _logarithmic(member)]
    if isinstance(axis, Designed):
        return [item.kind in _LOGARITHMIC for item in axis.distributions]
    return [isinstance(axis, Ranged) and axis.logarithmic] * len(axis.paths)


def _scattered(axis: Axis) -> bool:
    if isinstance(axis, Zipped):
        return any(_scattered(member) for member in axis.members)
    return isinstance(axis, Designed | FromFile)
