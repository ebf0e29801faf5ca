"""A store as a labelled data set."""

from pathlib import Path
from typing import TYPE_CHECKING

from .attributes import read_attributes
from .errors import StoreError

if TYPE_CHECKING:
    import xarray


def open_dataset(folder: str | Path) -> "xarray.Dataset":
    """The rows of a store, done or not, as ``xarray.open_zarr`` opens them; nothing is read but what is asked for.

    **Raises:** :class:`StoreError` when there is nothing at ``folder``, or something other than the store of a study.
    """
    # Imported here, because it takes longer than all of jaxball's own modules.
    import xarray

    folder = Path(folder)
    if not folder.exists():
        raise StoreError(f'There must be the store of a study at "{folder}", but there is nothing.')
    read_attributes(folder)
    return xarray.open_zarr(folder, chunks=None)
