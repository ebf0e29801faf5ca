"""Opens a store as a labelled data set, and some of its rows as scenarios."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..interface.wording import number_of
from ..scenario import Scenario, ScenarioError, read_document
from ..scenario.paths import with_numbers
from ..simulation.events import AbstractEvent, Detachment
from .errors import StoreError
from .files import check_intact
from .outputs import AXES, NAMES, OWN_UNITS
from .store import read_attributes
from .study import ends_at_detachment

if TYPE_CHECKING:
    import xarray


def open_dataset(folder: str | Path) -> "xarray.Dataset":
    """Opens the rows of a store, done or not, as ``xarray.open_zarr`` does; data are read only when used.

    Joints have their names as labels, ``data["theta"].sel(driven="mechanisms[0].joints[1]")``. In the store these are
    an attribute, ``names``, because not every library reads strings from Zarr; so are the units of states of one's own,
    here the coordinate ``own_unit``, as in a saved run.

    **Raises:** :class:`StoreError` when there is nothing at ``folder``, or something other than the store of a study,
    and when a file of it has been removed or its length changed from outside. A file with other numbers is a
    ``ValueError`` of Zarr when it is read; :func:`describe` names it.
    """
    # Imported here, because it takes longer than all of jaxball's own modules.
    import xarray

    read_attributes(Path(folder))
    # Reading all numbers to check them would take as long as a large store is; Zarr checks those that are read.
    check_intact(Path(folder), numbers=False)
    # Without dask's chunks: nothing is read before it is used, and dask need not be installed.
    data = xarray.open_zarr(folder, chunks=None)
    named: dict[Any, Any] = {name: data[name].attrs[NAMES] for name in data.indexes if NAMES in data[name].attrs}
    if "own" in data and OWN_UNITS in data["own"].attrs:
        named["own_unit"] = ("own_state", data["own"].attrs[OWN_UNITS])
    return data.assign_coords(named)


def open_grid(folder: str | Path) -> "xarray.Dataset":
    """Opens the rows of the store at ``folder`` along its study's axes: ``grid.sel({"body.mass": 1.0})`` selects by
    value.

    The first dimensions are the axes, in the study's order. An axis of a single number has its path as name and its
    values as coordinate. An axis of several numbers, such as a design, is called ``axes[k]``, counted from 0, and its
    numbers are coordinates along it. Rows that are not done are NaN, or -1 for whole numbers.

    **Raises:** :class:`StoreError` as :func:`open_dataset`.
    """
    import xarray

    from .grid import cross_axes

    return cross_axes(open_dataset(folder), xarray.open_zarr(folder, group=AXES, chunks=None))


def row_events(folder: str | Path) -> dict[str, AbstractEvent]:
    """Returns the events that may have ended the runs of the store at ``folder``, by name, for :func:`row_scenarios`.

    **Raises:** :class:`StoreError` as :func:`open_dataset`.
    """
    return {"detachment": Detachment()} if ends_at_detachment(read_attributes(Path(folder))["settings"]) else {}


def row_scenarios(folder: str | Path, rows: Sequence[int]) -> list[Scenario]:
    """Returns the scenarios of some ``rows``, from 0, of the store at ``folder``.

    Simulated with :func:`row_events`, they repeat the runs of these rows.

    They have all save times, even where the study kept only the end.

    **Raises:** :class:`StoreError` as :func:`open_dataset`, and for a row that does not exist, is not computed yet, or
    has impossible numbers.
    """
    check_intact(Path(folder))
    data = open_dataset(folder)
    paths, count = np.atleast_1d(data.attrs["paths"]).tolist(), data.sizes["row"]
    beyond = [row for row in rows if not 0 <= row < count]
    if beyond:
        raise StoreError(
            f'Rows must be among the {number_of(count, "row")} of "{folder}", from 0 to {count - 1}, but {beyond[0]} '
            "is not."
        )
    document, chosen = tomllib.loads(data.attrs["scenario"]), data[["row", *paths]].isel(row=list(rows)).load()
    scenarios = []
    for k, row in enumerate(rows):
        # Rows that are not computed have the fill value.
        if chosen["row"].values[k] < 0:
            raise StoreError(f'Rows must be computed, but row {row} of "{folder}" is not done yet.')
        values = {path: float(chosen[path].values[k]) for path in paths}
        try:
            scenarios.append(read_document(with_numbers(document, values)))
        except ScenarioError as error:
            raise StoreError(f"Row {row}: {error}") from None
    return scenarios
