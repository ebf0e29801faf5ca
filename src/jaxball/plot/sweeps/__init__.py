"""Figures of studies, from the data set that ``xarray.open_zarr`` makes of a store."""
