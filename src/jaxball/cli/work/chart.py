"""Charts over two numbers of a scenario: their axes, and their files."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...sweep.axes import Ranged
from ..chart import Axis

if TYPE_CHECKING:
    import xarray


def ranged(axes: tuple[Axis, Axis]) -> tuple[Ranged, Ranged]:
    """The axes of the command line as those of a study."""
    first, second = (Ranged(*axis, False) for axis in axes)
    return first, second


def save_chart(chart: "xarray.Dataset", path: Path) -> None:
    """Writes a chart as netCDF, or as a table with one row for each cell."""
    if path.suffix == ".nc":
        chart.to_netcdf(path, engine="h5netcdf")
        return
    names = [str(name) for name in chart.data_vars]
    up, right = chart[names[0]].dims
    grids = np.meshgrid(chart[up].values, chart[right].values, indexing="ij")
    columns = [*map(np.ravel, grids), *(chart[name].values.ravel() for name in names)]
    header = ",".join([str(up), str(right), *names])
    np.savetxt(path, np.column_stack(columns), fmt="%.17g", delimiter=",", header=header, comments="")
