"""The store of a study as labelled data sets, of rows or on the grid of its axes, and some of its rows as scenarios."""

import functools
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray
from xarray.backends import BackendArray
from xarray.core import indexing

from ...files.scenario import read_document
from ...files.scenario.errors import ScenarioError
from ...files.scenario.paths import with_numbers
from ...files.scenario.scenario import Scenario
from ...interface.status import Status
from ...interface.wording import heading, number_of
from ...simulation.events import AbstractEvent, Detachment
from .files import STATUS, StoreError, check_intact, read_chunk
from .outputs import AXES, NAMES, OWN_UNITS, dimensions
from .progress import status_counts
from .store import read_attributes
from .study import ends_at_detachment


class StoredStudy(NamedTuple):
    """The store of a study, finished or not, at a ``folder``, which is read when one of these is called."""

    folder: Path

    def dataset(self) -> xarray.Dataset:
        """Opens the rows, done or not, as ``xarray.open_zarr`` does; data are read only when used.

        Joints have their names as labels, ``data["theta"].sel(driven="mechanisms[0].joints[1]")``. In the store these
        are an attribute, ``names``, because not every library reads strings from Zarr; so are the units of states of
        one's own, here the coordinate ``own_unit``, as in a saved run.

        **Raises:** :class:`StoreError` when there is nothing at its ``folder``, or something other than the store of a
        study, and when a file of it has been removed or its length changed from outside. A file with other numbers is a
        ``ValueError`` of Zarr when it is read; :meth:`describe` names it.
        """
        read_attributes(self.folder)
        # Reading all numbers to check them would take as long as a large store is; Zarr checks those that are read.
        check_intact(self.folder, numbers=False)
        # Without dask's chunks: nothing is read before it is used, and dask need not be installed.
        data = xarray.open_zarr(self.folder, chunks=None)
        named: dict[Any, Any] = {name: data[name].attrs[NAMES] for name in data.indexes if NAMES in data[name].attrs}
        if "own" in data and OWN_UNITS in data["own"].attrs:
            named["own_unit"] = ("own_state", data["own"].attrs[OWN_UNITS])
        return data.assign_coords(named)

    def grid(self) -> xarray.Dataset:
        """Opens the rows along the axes of the study: ``grid.sel({"body.mass": 1.0})`` selects by value.

        The first dimensions are the axes, in the study's order. An axis of a single number has its path as name and its
        values as coordinate. An axis of several numbers, such as a design, is called ``axes[k]``, counted from 0, and
        its numbers are coordinates along it. Rows that are not done are NaN, or -1 for whole numbers.

        **Raises:** :class:`StoreError` as :meth:`dataset`.
        """
        return cross_axes(self.dataset(), xarray.open_zarr(self.folder, group=AXES, chunks=None))

    def events(self) -> dict[str, AbstractEvent]:
        """Returns the events that may have ended its runs, by name, for :meth:`scenarios`.

        **Raises:** :class:`StoreError` as :meth:`dataset`.
        """
        return {"detachment": Detachment()} if ends_at_detachment(read_attributes(self.folder)["settings"]) else {}

    def scenarios(self, rows: Sequence[int]) -> list[Scenario]:
        """Returns the scenarios of some ``rows``, from 0.

        Simulated with :meth:`events`, they repeat the runs of these rows.

        They have all save times, even where the study kept only the end.

        **Raises:** :class:`StoreError` as :meth:`dataset`, and for a row that does not exist, is not computed yet, or
        has impossible numbers.
        """
        check_intact(self.folder)
        data = self.dataset()
        paths, count = np.atleast_1d(data.attrs["paths"]).tolist(), data.sizes["row"]
        beyond = [row for row in rows if not 0 <= row < count]
        if beyond:
            raise StoreError(
                f'Rows must be among the {number_of(count, "row")} of "{self.folder}", from 0 to {count - 1}, but '
                f"{beyond[0]} is not."
            )
        document, chosen = tomllib.loads(data.attrs["scenario"]), data[["row", *paths]].isel(row=list(rows)).load()
        scenarios = []
        for k, row in enumerate(rows):
            # Rows that are not computed have the fill value.
            if chosen["row"].values[k] < 0:
                raise StoreError(f'Rows must be computed, but row {row} of "{self.folder}" is not done yet.')
            values = {path: float(chosen[path].values[k]) for path in paths}
            try:
                scenarios.append(read_document(with_numbers(document, values)))
            except ScenarioError as error:
                raise StoreError(f"Row {row}: {error}") from None
        return scenarios

    def describe(self) -> str:
        """Describes how many rows are done, their statuses, how many left the plane, and what is wrong with the
        first row that failed.

        **Raises:** :class:`StoreError` when there is nothing at its ``folder``, or something other than the store of a
        study, and when a file of it has been changed from outside.
        """
        folder, attributes = self.folder, read_attributes(self.folder)
        check_intact(folder)
        counts = status_counts(folder)
        lines = [heading(attributes["title"])] if attributes["title"] else []
        lines.append(
            f"{counts.rows:,} of {attributes['rows']:,} rows are done ({100 * counts.rows / attributes['rows']:.1f} %)"
        )
        lines += [f"  {int(counts.counts[status]):,} {status.name}" for status in Status if counts.counts[status]]
        if counts.left:
            lines.append(
                f"  {number_of(counts.left, 'row')} with a least normal force that is not positive (`left_plane`): the "
                "body would leave the ground, and the equations of rolling do not hold after that"
            )
        if counts.first is not None:
            lines.append(_failure(folder, attributes, counts.first))
        return "\n".join(lines)


def open_store(folder: str | Path) -> StoredStudy:
    """Opens the store at ``folder``, of a study whose run has begun."""
    return StoredStudy(Path(folder))


def _failure(folder: Path, attributes: Mapping[str, Any], row: int) -> str:
    size = attributes["chunk"]
    chunk, place = divmod(row, size)

    def read(name: str, dtype: np.dtype) -> Any:
        return read_chunk(folder / name / "c" / str(chunk), (size,), dtype)[place]

    values = {path: float(read(path, np.dtype("f8"))) for path in attributes["paths"]}
    shown = ", ".join(f"{path} = {value:.6g}" for path, value in values.items())
    status = Status(int(read("status", STATUS)))
    line = f"  the first failed row is {row}, {status.name}, with {shown}"
    try:
        read_document(with_numbers(tomllib.loads(attributes["scenario"]), values))
    except ScenarioError as error:
        line += f"\n  {error}"
    return line


def cross_axes(data: xarray.Dataset, points: xarray.Dataset) -> xarray.Dataset:
    """Puts the rows in ``data`` along the axes of their study; ``points`` are the values along these."""
    axes, shape = dimensions(data.attrs["paths"], data.attrs["path_axis"]), tuple(data.attrs["shape"])
    counted = {name: np.arange(size) for name, size in zip(axes, shape, strict=True) if name not in points.variables}
    crossed = {
        name: _cross_variable(item, axes, shape)
        for name, item in data.variables.items()
        if name not in points.variables
    }
    coordinates = {name: crossed.pop(name) for name in data.coords if name in crossed}
    return xarray.Dataset(crossed, {**counted, **points.variables, **coordinates}, data.attrs)


def _cross_variable(variable: Any, axes: list[str], shape: tuple[int, ...]) -> Any:
    """Puts a variable along the axes in place of its dimension ``row``, if it has one."""
    if variable.dims[:1] != ("row",):
        return variable
    # Not read yet: a grid may be much larger than what is looked at.
    lazy = indexing.LazilyIndexedArray(_Crossed(variable, shape))
    return xarray.Variable((*axes, *variable.dims[1:]), lazy, variable.attrs)


class _Crossed(BackendArray):
    """A variable over rows as an array over the points of all axes, read when it is indexed."""

    def __init__(self, variable: Any, axes: tuple[int, ...]):
        self.variable, self.axes = variable, axes
        self.shape, self.dtype = (*axes, *variable.shape[1:]), variable.dtype

    def __getitem__(self, key: Any) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        along, rest = key[: len(self.axes)], key[len(self.axes) :]
        # The last axis changes fastest, as in the rows of a study.
        strides = np.cumprod([1, *self.axes[:0:-1]])[::-1]
        places = [stride * np.arange(size)[k] for stride, size, k in zip(strides, self.axes, along, strict=True)]
        rows = np.asarray(functools.reduce(np.add.outer, places))
        values = self.variable[(rows.ravel(), *rest)].values
        return values.reshape(rows.shape + values.shape[1:])
