"""A store as a labelled data set."""

from pathlib import Path
from typing import TYPE_CHECKING

from .attributes import read_attributes
from .errors import StoreError
from .layout import AXES, NAMES
from .whole import check_whole

if TYPE_CHECKING:
    import xarray


def open_dataset(folder: str | Path) -> "xarray.Dataset":
    """The rows of a store, done or not, as ``xarray.open_zarr`` opens them; data are read only when used.

    Joints have their names as labels, ``data["theta"].sel(driven="mechanisms[0].joints[1]")``. In the store these are
    an attribute, ``names``, because not every library reads strings from Zarr.

    **Raises:** :class:`StoreError` when there is nothing at ``folder``, or something other than the store of a study,
    and when a file of it has been removed or its length changed from outside. A file with other numbers is a
    ``ValueError`` of Zarr when it is read; :func:`describe` names it.
    """
    # Imported here, because it takes longer than all of jaxball's own modules.
    import xarray

    read_attributes(Path(folder))
    check_whole(Path(folder), numbers=False)
    data = xarray.open_zarr(folder, chunks=None)
    named = {name: data[name].attrs[NAMES] for name in data.indexes if NAMES in data[name].attrs}
    return data.assign_coords(named)


def open_grid(folder: str | Path) -> "xarray.Dataset":
    """The same along the axes of the study, so that ``grid.sel({"body.mass": 1.0})`` selects by value.

    The first dimensions are the axes, in the study's order. An axis of a single number has its path as name and its
    values as coordinate. An axis of several numbers, such as a design, is called ``axes[k]``, counted from 0, and its
    numbers are coordinates along it. Rows that are not done are NaN, or -1 for whole numbers.

    **Arguments:**

    - ``folder``: the store.

    **Raises:** :class:`StoreError` as :func:`open_dataset`, and for a store that holds no points of its axes.
    """
    import xarray

    from .grid import crossed

    data = open_dataset(folder)
    if not (Path(folder) / AXES).is_dir():
        raise StoreError(
            f'The store "{folder}" must contain the points of its axes, but another version of jaxball wrote it '
            "without them; use open_dataset for its rows."
        )
    return crossed(data, xarray.open_zarr(folder, group=AXES, chunks=None, consolidated=False))
