"""The rows of a study that were computed, and where they lie along its axes."""

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ...interface.status import Status
from ...interface.wording import did_you_mean
from .errors import PictureError

if TYPE_CHECKING:
    import xarray

_NEEDED = ("shape", "paths", "path_axis", "path_logarithmic", "axis_scattered")


@dataclasses.dataclass(frozen=True)
class Rows:
    """Some of the computed rows of a study.

    - ``data``: the data set of all rows.
    - ``places``: where these rows are in it.
    - ``indices``: the index of each along each axis.
    - ``status``: how each ended.
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
        """Whether the values at ``path`` are spread by their logarithm."""
        return bool(listed(self.data, "path_logarithmic")[self.paths.index(path)])

    def number(self, path: str) -> Float[np.ndarray, " rows"]:
        """The number at ``path`` in each row."""
        self.axis_of(path)
        return self.data[path].values[self.places]

    def varying(self) -> list[str]:
        """The paths whose numbers are not the same in all rows."""
        return [path for path in self.paths if np.ptp(self.number(path)) > 0]

    def chosen(self, which: Bool[np.ndarray, " rows"] | Int[np.ndarray, " some"]) -> "Rows":
        """Those of the rows that a mask or indices choose."""
        return dataclasses.replace(
            self, places=self.places[which], indices=self.indices[which], status=self.status[which]
        )


def rows_of(data: "xarray.Dataset") -> Rows:
    """The rows that were computed.

    **Raises:** :class:`PictureError` when ``data`` is not of a study, when nothing in it was computed, and when all
    rows failed.
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
            "`jaxball sweep status` says what is wrong with the first of them."
        )
    indices = np.stack(np.unravel_index(row[computed], tuple(listed(data, "shape"))), axis=1)
    return Rows(data, computed, indices, status)


def listed(data: Any, name: str) -> list[Any]:
    """An attribute that is a list; files of some formats hold a list of one as a number or a text."""
    value = data.attrs[name]
    return [value] if isinstance(value, str) else np.atleast_1d(value).tolist()
