"""The axes of a study: which numbers change together, and their values at each of its points."""

import dataclasses
import functools
import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from ...files.scenario.errors import describe, key_error
from ...files.scenario.table import Key, Keys, read_one_of, read_table
from ...files.scenario.values import Choice, Integer, Numbers, Text, unread
from .files import StudyError

Design = Callable[[Int[np.ndarray, " points"], int, int, int], Float[np.ndarray, "points numbers"]]


def random(indices: Int[np.ndarray, " points"], count: int, dimension: int, seed: int) -> np.ndarray:
    """Draws independent uniform numbers, computed for each point from its index alone by a counter-based generator."""
    blocks = -(-dimension // 4)  # of four numbers for a step of the counter
    # Neighbouring points come from one call of the generator, and a point that occurs several times is computed once.
    different, places = np.unique(indices, return_inverse=True)
    runs = np.split(different, np.flatnonzero(np.diff(different) > 1) + 1)
    bits = [np.random.Philox(key=seed, counter=int(run[0]) * blocks).random_raw(4 * blocks * len(run)) for run in runs]
    words = np.concatenate(bits).reshape(-1, 4 * blocks)[places, :dimension]
    # The upper 53 bits, as many as a number in double precision holds.
    return (words >> np.uint64(11)).astype(float) * 2.0**-53


# A Latin hypercube has one point in each of ``count`` equal intervals of each dimension. Of Sobol's sequence, which is
# scrambled, it is the first ``count`` points, a power of two.
DESIGNS: Mapping[str, Design] = {
    "random": random,
    "latin-hypercube": lambda indices, *numbers: _cube("LatinHypercube", *numbers)[indices],
    "sobol": lambda indices, *numbers: _cube("Sobol", *numbers)[indices],
}


# Each of these points depends on all the others; a process usually needs only one design.
@functools.lru_cache(maxsize=4)
def _cube(sampler: str, count: int, dimension: int, seed: int) -> np.ndarray:
    from scipy.stats import qmc

    return getattr(qmc, sampler)(dimension, rng=seed).random(count)


# The smallest and the largest number of 53 random bits, moved off 0 and 1, where the normal quantile is infinite.
_EDGE = 2.0**-54


def _normal(u: np.ndarray) -> np.ndarray:
    # Imported here, because it belongs to the extra `sweep`.
    from scipy.special import ndtri

    return ndtri(np.clip(u, _EDGE, 1 - _EDGE))


_INVERSES: Mapping[str, Callable[[np.ndarray, float, float], np.ndarray]] = {
    "uniform": lambda u, low, high: low + (high - low) * u,
    "log-uniform": lambda u, low, high: low * (high / low) ** u,
    "normal": lambda u, mean, deviation: mean + deviation * _normal(u),
    "lognormal": lambda u, median, deviation: median * np.exp(deviation * _normal(u)),
}


@dataclass(frozen=True)
class Distribution:
    """A distribution of a number.

    - ``uniform``: between two numbers, the smaller one first.
    - ``log-uniform``: between two positive numbers, the smaller one first, its logarithm uniform.
    - ``normal``: the mean and the standard deviation.
    - ``lognormal``: the median, and the standard deviation of the logarithm.
    """

    kind: str
    first: float
    second: float

    def inverse(self, u: np.ndarray) -> np.ndarray:
        """Computes the quantiles of the distribution at ``u``, 0 ≤ u < 1."""
        return _INVERSES[self.kind](u, self.first, self.second)


DISTRIBUTIONS = {name: {name: Key(Numbers((2,)), says=(Distribution, name))} for name in _INVERSES}


def read_distribution(values: Any, path: str) -> Distribution:
    """Reads the distribution that a table such as ``{ normal = [0.0, 0.1] }`` describes.

    **Raises:** :class:`~jaxball.ScenarioError` for an unknown distribution, and for invalid parameters.
    """
    kind, table = read_one_of(values, path, DISTRIBUTIONS)
    first, second = map(float, table[kind])
    path, got = f"{path}.{kind}", describe(values[kind])
    if kind in ("uniform", "log-uniform") and not first < second:
        raise key_error(path, "two numbers, the smaller one first", got)
    if kind == "log-uniform" and not first > 0:
        raise key_error(path, "two positive numbers", got)
    if kind in ("normal", "lognormal") and not second > 0:
        raise key_error(path, "a number and a positive standard deviation", got)
    if kind == "lognormal" and not first > 0:
        raise key_error(path, "a positive median and a positive standard deviation", got)
    return Distribution(kind, first, second)


@functools.lru_cache(maxsize=4)
def _table(path: Path, digest: str) -> tuple[tuple[str, ...], np.ndarray]:
    """Reads the names of a file's columns and its rows; ``digest`` is the SHA-256 of its bytes."""
    # Imported here, because it belongs to the extra `sweep`.
    import pyarrow.csv
    import pyarrow.parquet

    content = path.read_bytes()
    # The file is read again in each process, and must still be the one by which the study is identified.
    if hashlib.sha256(content).hexdigest() != digest:
        raise StudyError(
            f'Key `points` must be a file that does not change while a study runs, but "{path}" has changed.'
        )
    if path.suffix not in (".csv", ".parquet"):
        raise StudyError(f'Key `points` must be a .csv or .parquet file, but it is "{path}".')
    try:
        read = pyarrow.csv.read_csv if path.suffix == ".csv" else pyarrow.parquet.read_table
        table = read(pyarrow.BufferReader(content))
    except (ValueError, OSError) as error:
        raise StudyError(f'Key `points` must be a table, but "{path}" is not: {error}.') from None
    for field in table.schema if table.num_rows else ():
        if not (pyarrow.types.is_integer(field.type) or pyarrow.types.is_floating(field.type)):
            raise StudyError(
                f'Column `{field.name}` of "{path}" must contain only numbers, but it contains {field.type}.'
            )
    columns = [np.asarray(column.to_numpy(), dtype=float) for column in table.columns]
    return tuple(table.column_names), np.stack(columns, axis=1)


MOST_POINTS = 10**9
_POINTS = Integer(1, MOST_POINTS)
_SEED = Key(Integer(0, 2**63 - 1), 0, says="the seed of the random numbers")


@runtime_checkable
class Axis(Protocol):
    """Numbers that change together, and their values, computed from the index of a point alone."""

    @property
    def paths(self) -> tuple[str, ...]: ...

    @property
    def size(self) -> int: ...

    def values(self, indices: Int[np.ndarray, " points"]) -> Float[np.ndarray, "points numbers"]: ...


@dataclasses.dataclass(frozen=True)
class _OfNumber:
    """An axis of one number."""

    path: str

    @property
    def paths(self) -> tuple[str, ...]:
        return (self.path,)


@dataclasses.dataclass(frozen=True)
class Listed(_OfNumber):
    """One number, its values listed."""

    listed: tuple[float, ...]

    @property
    def size(self) -> int:
        return len(self.listed)

    def values(self, indices: Int[np.ndarray, " points"]) -> Float[np.ndarray, "points numbers"]:
        return np.asarray(self.listed)[indices][:, None]


@dataclasses.dataclass(frozen=True)
class Ranged(_OfNumber):
    """One number, its values, or their logarithms, equally spaced from ``first`` to ``last``."""

    first: float
    last: float
    size: int
    logarithmic: bool

    def values(self, indices: Int[np.ndarray, " points"]) -> Float[np.ndarray, "points numbers"]:
        share = indices / max(self.size - 1, 1)
        if self.logarithmic:
            between = self.first * (self.last / self.first) ** share
        else:
            between = self.first + (self.last - self.first) * share
        # The last value exactly, in spite of rounding.
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
        # The file must be as it was when the study was read.
        return _table(self.file, self.digest)[1][indices]


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


def keys_of_paths(axis: Axis, key: str) -> Iterator[tuple[str, str]]:
    """Lists each path of the axis at ``key``, with the key that has it as its value, or that names the file
    it is in.
    """
    if isinstance(axis, Zipped):
        for k, member in enumerate(axis.members):
            yield from keys_of_paths(member, f"{key}.zip[{k}]")
        return
    name = "numbers" if isinstance(axis, Designed) else "points" if isinstance(axis, FromFile) else "path"
    for path in axis.paths:
        yield path, f"{key}.{name}"


_TABLES = unread("a list of tables, one or more", forms=("list",))
_PATH = Key(Text(), says="the path of a number in the scenario")
_RANGE: Keys = {
    "from": Key(Numbers(), says="the first value, in `log` positive"),
    "to": Key(Numbers(), says="the last value, in `log` positive"),
    "count": Key(_POINTS, says="the number of values"),
}
_DESIGN: Keys = {
    "design": Key(Choice(tuple(DESIGNS)), says="how points are chosen"),
    "count": Key(_POINTS, says='the number of points, a power of two for "sobol"'),
    "seed": _SEED,
    "numbers": Key(unread(tables=DISTRIBUTIONS, forms=("by name",)), says="a distribution for each path"),
}
AXES: Mapping[str, Keys] = {
    "values": {"path": _PATH, "values": Key(Numbers((None,)), says="the values themselves")},
    "linear": {"path": _PATH, "linear": Key(unread(tables={"": _RANGE}), says="equally spaced values")},
    "log": {"path": _PATH, "log": Key(unread(tables={"": _RANGE}), says="logarithmically spaced values")},
    "design": _DESIGN,
    "points": {"points": Key(Text(), says="a CSV or Parquet file whose columns are named by paths")},
    "zip": {"zip": Key(_TABLES, says="axes of the same size that vary together")},
}


def read_axis(values: Any, path: str, folder: Path) -> Axis:
    """Reads the axis that a table describes; its files are relative to ``folder``.

    **Raises:** :class:`~jaxball.ScenarioError`, with one sentence that names the key.
    """
    choice, table = read_one_of(values, path, AXES)
    if choice == "values":
        return Listed(table["path"], tuple(table["values"].tolist()))
    if choice in ("linear", "log"):
        return _read_range(choice, table, path)
    return _read_design(table, path) if choice == "design" else _READERS[choice](table, path, folder)


def _read_range(spacing: str, table: dict[str, Any], path: str) -> Axis:
    limits = read_table(table[spacing], f"{path}.{spacing}", _RANGE)
    for name in ("from", "to"):
        if spacing == "log" and limits[name] <= 0:
            raise key_error(f"{path}.log.{name}", "a positive number", repr(limits[name]))
    return Ranged(table["path"], limits["from"], limits["to"], limits["count"], spacing == "log")


def _read_design(table: dict[str, Any], path: str) -> Axis:
    numbers, count = table["numbers"], table["count"]
    if not isinstance(numbers, dict) or not numbers:
        raise key_error(f"{path}.numbers", "a table with a distribution for each path", describe(numbers))
    if table["design"] == "sobol" and count & (count - 1):
        # Only then do its points cover the cube evenly.
        raise key_error(f"{path}.count", "a power of two for a Sobol design", repr(count))
    distributions = tuple(read_distribution(item, f'{path}.numbers."{name}"') for name, item in numbers.items())
    return Designed(table["design"], count, table["seed"], tuple(numbers), distributions)


def _from_file(table: dict[str, Any], path: str, folder: Path) -> Axis:
    file = (folder / table["points"]).resolve()
    try:
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise StudyError(
            f'Key `points` must be a file that can be read, but "{file}" cannot: {error.strerror}.'
        ) from None
    names, rows = _table(file, digest)
    if not len(rows):
        raise StudyError(f'Key `{path}.points` must be a file with one row or more, but "{file}" has none.')
    return FromFile(file, digest, names, len(rows))


def _read_zip(table: dict[str, Any], path: str, folder: Path) -> Axis:
    if not isinstance(table["zip"], list) or not table["zip"]:
        raise key_error(f"{path}.zip", _TABLES.words, describe(table["zip"]))
    members = tuple(read_axis(item, f"{path}.zip[{k}]", folder) for k, item in enumerate(table["zip"]))
    sizes = [member.size for member in members]
    if len(set(sizes)) > 1:
        raise key_error(f"{path}.zip", "axes with the same number of points", f"axes with {sizes}")
    return Zipped(members)


_READERS: Mapping[str, Callable[[dict[str, Any], str, Path], Axis]] = {
    "points": _from_file,
    "zip": _read_zip,
}
