"""The layout of a study's rows along its axes, as attributes from which its store can be drawn."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from .axes import Axis, Designed, FromFile, Ranged, Zipped
from .study import Study

AXES = "axes"  # the group of a store that holds the points of each axis
NAMES = "names"  # the attribute that has the labels along a dimension, if they are not numbers
_LOGARITHMIC = ("log-uniform", "lognormal")


def layout_of(study: Study) -> dict[str, list[Any]]:
    """For each path, its axis and whether its values are spaced logarithmically; for each axis, whether its points are
    scattered; the names of what the study finds. Lists of numbers and strings, which every file format can hold.
    """
    finds = {"finds": [find.name for find in study.finds]} if study.finds else {}
    return finds | {
        "path_axis": [k for k, axis in enumerate(study.axes) for _ in axis.paths],
        "path_logarithmic": [int(item) for axis in study.axes for item in _logarithmic(axis)],
        "axis_scattered": [int(_scattered(axis)) for axis in study.axes],
    }


def dimensions(paths: Sequence[str], path_axis: Sequence[int]) -> list[str]:
    """The name of each axis as a dimension: the path of its one number, or else its index in the study, ``axes[0]``."""
    numbers = Counter(path_axis)
    alone = {axis: path for path, axis in zip(paths, path_axis, strict=True) if numbers[axis] == 1}
    return [alone.get(axis, f"{AXES}[{axis}]") for axis in sorted(numbers)]


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
