"""Studies to draw: the disks of ``tests.sweep.studies``, some of which fail, and balls on straight lines."""

import functools
import tempfile
from pathlib import Path

import numpy as np
import xarray

from jaxball import Status
from tests.sweep.studies import GRAVITIES, pretend, study

MASSES = '[[axes]]\npath = "body.mass"\nlog = { from = 0.5, to = 2.0, count = 5 }\n'
DESIGN = """
[[axes]]
design = "latin-hypercube"
count = 40
seed = 1
[axes.numbers]
"body.mass" = { log-uniform = [0.5, 2.0] }
"body.gravity" = { uniform = [0.5, 2.0] }
"""
HEAVY = 1.5  # the solve of a disk with m g above this fails at half its time
GRID = MASSES + GRAVITIES
m, g = np.geomspace(0.5, 2.0, 5), np.array([0.5, 1.0, 2.0])


def heavy_ones_fail(scenarios, wanted):
    """An engine: φ = m g, but for heavy disks."""
    arrays = {name: np.array(array) for name, array in pretend(scenarios, wanted).items()}
    failed = arrays["phi"][:, 0] > HEAVY
    arrays["status"][failed] = int(Status.MAX_STEPS)
    arrays["reached"][failed] /= 2
    for name in ("phi", "phidot", "z"):
        arrays[name][failed, arrays[name].shape[1] // 2 + 1 :] = np.nan
    return arrays


def store(folder, axes=GRID, settings="", engine=heavy_ones_fail, **options):
    """The store of a study of disks."""
    return study(folder, axes, settings).run(folder / "s.zarr", engine=engine, **options).store


@functools.cache
def disks(axes=GRID, settings=""):
    """The same as a data set that is in memory."""
    with tempfile.TemporaryDirectory() as folder, xarray.open_zarr(store(Path(folder), axes, settings)) as data:
        return data.load()


def balls(status, times=5):
    """Balls that roll from 0 with the velocities (k, 1), k = 0, 1, …, and fail at half their time."""
    n, t = len(status), np.linspace(0.0, 4.0, times)
    late = (np.asarray(status) != 0)[:, None] & (t > 2.0)
    k = np.arange(n, dtype=float)
    z = np.stack([k[:, None] * t, np.ones((n, 1)) * t], axis=-1)
    return xarray.Dataset(
        {
            "status": ("row", np.asarray(status, dtype=np.int8)),
            "steps": ("row", np.full(n, 7, dtype=np.int32)),
            "reached": ("row", np.where(status, 2.0, 4.0)),
            "z": (("row", "save", "direction"), np.where(late[..., None], np.nan, z), {"units": "length"}),
        },
        {
            "row": np.arange(n),
            "direction": [0, 1],
            "initial.speed": ("row", k),
            "time": (("row", "save"), np.tile(t, (n, 1))),
        },
        {"shape": [n], "paths": ["initial.speed"], "path_axis": [0], "path_logarithmic": [0], "axis_scattered": [0]},
    )
