"""The axes of a study: which numbers change together, and their values at each of its points."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from ..scenario.table import Key, Keys, read_one_of, read_table
from ..scenario.values import Choice, Integer, Numbers, Text, key_error, shown, unread
from .designs import DESIGNS
from .distributions import DISTRIBUTIONS, Distribution, read_distribution
from .errors import StudyError
from .points import points, read_points

MOST_POINTS = 10**9
_COUNT = Key(Integer(1, MOST_POINTS))
_SEED = Key(Integer(0, 2**63 - 1), 0)


@runtime_checkable
class Axis(Protocol):
    """Numbers that change together, and their values, computed from the index of a point alone."""

    @property
    def paths(self) -> tuple[str, ...]: ...

    @property
    def size(self) -> int: ...

    def values(self, indices: Int[np.ndarray, " points"]) -> Float[np.ndarray, "points numbers"]: ...


@dataclasses.dataclass(frozen=True)
class Listed:
    """One number, its values listed."""

    path: str
    listed: tuple[float, ...]

    @property
    def paths(self) -> tuple[str, ...]:
        return (self.path,)

    @property
    def size(self) -> int:
        return len(self.listed)

    def values(self, indices: Int[np.ndarray, " points"]) -> Float[np.ndarray, "points numbers"]:
        return np.asarray(self.listed)[indices][:, None]


@dataclasses.dataclass(frozen=True)
class Ranged:
    """One number, its values, or their logarithms, equally spaced from ``first`` to ``last``."""

    path: str
    first: float
    last: float
    size: int
    logarithmic: bool

    @property
    def paths(self) -> tuple[str, ...]:
        return (self.path,)

    def values(self, indices: Int[np.ndarray, " points"]) -> Float[np.ndarray, "points numbers"]:
        share = indices / max(self.size - 1, 1)
        if self.logarithmic:
            between = self.first * (self.last / self.first) ** share
        else:
            between = self.first + (self.last - self.first) * share
        return np.where((indices == self.size - 1) & (self.size > 1), self.last, between)[:, None]


@dataclasses.dataclass(frozen=True)
class Designed:
    """Numbers with distributions, at the points of a design."""

    design: str
    size: int
    seed: int
    paths: tuple[str, ...]
    distributions: tuple[Distribution, ...]

    def values(self, indices: Int[np.ndarray, " points"]) -> Float[np.ndarray, "points numbers"]:
        cube = DESIGNS[self.design](indices, self.size, len(self.paths), self.seed)
        columns = [item.inverse(cube[:, k]) for k, item in enumerate(self.distributions)]
        return np.stack(columns, axis=1)


@dataclasses.dataclass(frozen=True)
class FromFile:
    """Numbers whose values a file lists, each column named by a path; identified by the contents of the file."""

    file: Path = dataclasses.field(repr=False)
    digest: str
    paths: tuple[str, ...]
    size: int

    def values(self, indices: Int[np.ndarray, " points"]) -> Float[np.ndarray, "points numbers"]:
        return points(self.file, self.digest, indices)


@dataclasses.dataclass(frozen=True)
class Zipped:
    """Axes of the same size that advance together."""

    members: tuple[Axis, ...]

    @property
    def paths(self) -> tuple[str, ...]:
        return tuple(path for member in self.members for path in member.paths)

    @property
    def size(self) -> int:
        return self.members[0].size

    def values(self, indices: Int[np.ndarray, " points"]) -> Float[np.ndarray, "points numbers"]:
        return np.concatenate([member.values(indices) for member in self.members], axis=1)


_TABLES = unread("a list of tables, one or more")
_PATH = Key(Text())
_RANGE: Keys = {"from": Key(Numbers()), "to": Key(Numbers()), "count": _COUNT}
_DESIGN: Keys = {
    "design": Key(Choice(tuple(DESIGNS))),
    "count": _COUNT,
    "seed": _SEED,
    # A distribution for each path.
    "numbers": Key(unread(tables=DISTRIBUTIONS)),
}
AXES: Mapping[str, Keys] = {
    "values": {"path": _PATH, "values": Key(Numbers((None,)))},
    "linear": {"path": _PATH, "linear": Key(unread(tables={"": _RANGE}))},
    "log": {"path": _PATH, "log": Key(unread(tables={"": _RANGE}))},
    "design": _DESIGN,
    "points": {"points": Key(Text())},
    "zip": {"zip": Key(_TABLES)},
}


def read_axis(values: Any, path: str, folder: Path) -> Axis:
    """The axis that a table describes; its files are relative to ``folder``.

    **Raises:** :class:`~jaxball.scenario.ScenarioError`, with one sentence that names the key.
    """
    choice, table = read_one_of(values, path, AXES)
    return _READERS[choice](table, path, folder)


def _listed(table: dict[str, Any], path: str, folder: Path) -> Axis:
    return Listed(table["path"], tuple(table["values"].tolist()))


def _linear(table: dict[str, Any], path: str, folder: Path) -> Axis:
    limits = read_table(table["linear"], f"{path}.linear", _RANGE)
    return Ranged(table["path"], limits["from"], limits["to"], limits["count"], False)


def _log(table: dict[str, Any], path: str, folder: Path) -> Axis:
    limits = read_table(table["log"], f"{path}.log", _RANGE)
    for name in ("from", "to"):
        if limits[name] <= 0:
            raise key_error(f"{path}.log.{name}", "a positive number", repr(limits[name]))
    return Ranged(table["path"], limits["from"], limits["to"], limits["count"], True)


def _designed(table: dict[str, Any], path: str, folder: Path) -> Axis:
    numbers, count = table["numbers"], table["count"]
    if not isinstance(numbers, dict) or not numbers:
        raise key_error(f"{path}.numbers", "a table with a distribution for each path", shown(numbers))
    if table["design"] == "sobol" and count & (count - 1):
        raise key_error(f"{path}.count", "a power of two for a Sobol design", repr(count))
    distributions = tuple(read_distribution(item, f'{path}.numbers."{name}"') for name, item in numbers.items())
    return Designed(table["design"], count, table["seed"], tuple(numbers), distributions)


def _from_file(table: dict[str, Any], path: str, folder: Path) -> Axis:
    file = (folder / table["points"]).resolve()
    names, digest, size = read_points(file)
    if not size:
        raise StudyError(f'Key `{path}.points` must be a file with one row or more, but "{file}" has none.')
    return FromFile(file, digest, names, size)


def _zipped(table: dict[str, Any], path: str, folder: Path) -> Axis:
    if not isinstance(table["zip"], list) or not table["zip"]:
        raise key_error(f"{path}.zip", _TABLES.words, shown(table["zip"]))
    members = tuple(read_axis(item, f"{path}.zip[{k}]", folder) for k, item in enumerate(table["zip"]))
    sizes = [member.size for member in members]
    if len(set(sizes)) > 1:
        raise key_error(f"{path}.zip", "axes with the same number of points", f"axes with {sizes}")
    return Zipped(members)


_READERS: Mapping[str, Callable[[dict[str, Any], str, Path], Axis]] = {
    "values": _listed,
    "linear": _linear,
    "log": _log,
    "design": _designed,
    "points": _from_file,
    "zip": _zipped,
}
