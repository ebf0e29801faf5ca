"""The computed rows of a study, their positions along its axes, and which of them a figure shows."""

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ...interface.status import Status
from ...interface.wording import did_you_mean
from .symbols import Labels, number_label

if TYPE_CHECKING:
    import xarray

SEED = 0
FEW_PATHS = 2
_NEEDED = ("shape", "paths", "path_axis", "path_logarithmic", "axis_scattered")


class PictureError(ValueError):
    """A study cannot be drawn as requested; the message is one sentence."""


@dataclasses.dataclass(frozen=True)
class Rows:
    """Some of the computed rows of a study.

    - ``data``: the data set of all rows.
    - ``places``: the indices of these rows in it.
    - ``indices``: the index of each row along each axis.
    - ``status``: the status of each.
    """

    data: Any
    places: Int[np.ndarray, " rows"]
    indices: Int[np.ndarray, "rows axes"]
    status: Int[np.ndarray, " rows"]

    def __len__(self) -> int:
        return len(self.places)

    @property
    def paths(self) -> tuple[str, ...]:
        """The paths of the numbers that change."""
        return tuple(listed(self.data, "paths"))

    @property
    def failed(self) -> Bool[np.ndarray, " rows"]:
        """Which rows failed."""
        return self.status != Status.SUCCESS

    def axis_of(self, path: str) -> int:
        """The axis along which the number at ``path`` changes.

        **Raises:** :class:`PictureError` when the study changes no such number.
        """
        if path not in self.paths:
            hint = did_you_mean(path, self.paths, f"it changes {', '.join(self.paths)}", "`")
            raise PictureError(f"Path `{path}` must be one of the numbers that the study changes{hint}")
        return int(listed(self.data, "path_axis")[self.paths.index(path)])

    def paths_of(self, axis: int) -> tuple[str, ...]:
        """The paths of the numbers that change along an axis."""
        return tuple(path for path in self.paths if self.axis_of(path) == axis)

    def is_scattered(self, path: str) -> bool:
        """Whether the values at ``path`` are those of a design or of a file."""
        return bool(listed(self.data, "axis_scattered")[self.axis_of(path)])

    def is_logarithmic(self, path: str) -> bool:
        """Whether the values at ``path`` are spaced logarithmically."""
        return bool(listed(self.data, "path_logarithmic")[self.paths.index(path)])

    def number(self, path: str) -> Float[np.ndarray, " rows"]:
        """The number at ``path`` in each row."""
        self.axis_of(path)
        return self.data[path].values[self.places]

    def varying(self) -> list[str]:
        """The paths whose numbers are not the same in all rows."""
        return [path for path in self.paths if np.ptp(self.number(path)) > 0]

    def chosen(self, which: Bool[np.ndarray, " rows"] | Int[np.ndarray, " some"]) -> "Rows":
        """The rows that a mask or indices choose."""
        return dataclasses.replace(
            self, places=self.places[which], indices=self.indices[which], status=self.status[which]
        )


def rows_of(data: "xarray.Dataset") -> Rows:
    """The rows that were computed.

    **Raises:** :class:`PictureError` when ``data`` is not of a study, when none of its rows was computed, and when all
    of them failed.
    """
    missing = [name for name in _NEEDED if name not in data.attrs] + [
        name for name in ("row", "status") if name not in data.variables
    ]
    if missing:
        raise PictureError(
            "Argument `data` must be the store of a study, opened by xarray.open_zarr, but it has no "
            f"{', '.join(missing)}."
        )
    row, status = data["row"].values, data["status"].values.astype(int)
    computed = np.flatnonzero(row >= 0)
    if not computed.size:
        raise PictureError("Argument `data` must have a row that was computed, but none of its rows is done yet.")
    status = status[computed]
    if np.all(status != Status.SUCCESS):
        counts = ", ".join(f"{np.sum(status == code):,} {Status(code).name}" for code in np.unique(status).tolist())
        raise PictureError(
            f"Argument `data` must have a row that succeeded, but all {len(status):,} that are done failed: {counts}; "
            "see `jaxball sweep status` for what is wrong with the first of them."
        )
    indices = np.stack(np.unravel_index(row[computed], tuple(listed(data, "shape"))), axis=1)
    return Rows(data, computed, indices, status)


def at_fixed(
    rows: Rows, free: set[int], at: Mapping[str, float] | None, labels: Labels = None
) -> tuple[Rows, list[str]]:
    """The rows at one point of each axis that is not in ``free``, and sentences that say at which.

    The point is the one whose number is nearest to that in ``at``; by default it is, among the points at which a row
    succeeded, the middle one of an axis, or the first of a scattered axis.

    **Raises:** :class:`PictureError` when ``at`` has a number that the study does not change, or one of a free axis.
    """
    at = at or {}
    for path in at:
        if rows.axis_of(path) in free:
            raise PictureError(f"Argument `at` must have no number of an axis that is drawn, but it has `{path}`.")
    sentences = []
    for axis in sorted(set(range(rows.indices.shape[1])) - free):
        present = np.unique(rows.indices[:, axis])
        if len(present) == 1:
            continue
        paths = rows.paths_of(axis)
        given = [path for path in paths if path in at]
        if given:
            distances = sum(np.abs(rows.number(path) - at[path]) for path in given)
            point = rows.indices[np.argmin(distances), axis]
        else:
            succeeded = np.unique(rows.indices[~rows.failed, axis])
            candidates = succeeded if succeeded.size else present
            point = candidates[0 if rows.is_scattered(paths[0]) else len(candidates) // 2]
        rows = rows.chosen(rows.indices[:, axis] == point)
        if given or len(paths) <= FEW_PATHS:
            named = {path: number_label(path, labels, with_unit=False) for path in given or paths}
            sentences += [f"{name} = {rows.number(path)[0]:.4g}" for path, name in named.items()]
        else:
            sentences.append(f"point {point} of {number_label(paths[0], labels, with_unit=False)}, …")
    return rows, sentences


def sample(rows: Rows, most: int) -> tuple[Int[np.ndarray, " some"], list[str]]:
    """The indices of up to ``most`` rows, chosen by a generator with a fixed seed, and a sentence that says so.

    There is no sentence if all rows are chosen. Some of the failed rows are always chosen.
    """
    if len(rows) <= most:
        return np.arange(len(rows)), []
    generator, failed = np.random.default_rng(SEED), np.flatnonzero(rows.failed)
    some = generator.choice(failed, min(len(failed), max(1, most // 20)), replace=False)
    others = generator.choice(np.setdiff1d(np.arange(len(rows)), some), most - len(some), replace=False)
    drawn = np.sort(np.concatenate([some, others]))
    return drawn, [f"{len(drawn):,} of {len(rows):,} rows drawn"]


def listed(data: Any, name: str) -> list[Any]:
    """An attribute that is a list; some file formats store a list of one as a number or a text."""
    value = data.attrs[name]
    return [value] if isinstance(value, str) else np.atleast_1d(value).tolist()
