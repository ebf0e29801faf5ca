"""Figures of studies, from the data set that ``xarray.open_zarr`` returns for a store."""
