"""Saving a trajectory to a file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..interface.output import check_destination, replacing
from ..scenario import Scenario
from ..scenario.paths import entries
from ..simulation.trajectory import Trajectory
from .dataset import to_dataset
from .provenance import attributes
from .variables import values


def save(trajectory: Trajectory[Any, Any], path: str | Path, scenario: Scenario | None = None) -> Path:
    """Saves a trajectory with all its observables, or laws, in the format that the suffix of ``path`` names.

    - ``trajectory``: what :func:`jaxball.simulate` returns.
    - ``path``: where to, with its suffix.
    - ``scenario``: what the run came from, whose text is kept with it; None if there is none.
    - ``.nc``: netCDF, see :func:`to_dataset`; ``xarray.open_dataset(path)`` reads it.
    - ``.npz``: the same arrays, and the attributes as texts and numbers.
    - ``.csv``: a row for each time and a column for each number, named as ``Omega[1]`` or
      ``mass_positions_body[0][2]`` (mass 0, the third axis); the column ``status`` is 0 for a solve
      that reached its end, and the number of its :class:`~jaxball.Status` for one that failed.

    A failed solve is saved too, with its status, and NaN after the time that it reached. The file is
    written beside ``path`` and then moved there, so a failure never harms a file that exists. A symbolic
    link is followed.

    **Returns:** ``path``.

    **Raises:** :class:`OutputError` when the suffix is another one, or the file cannot be written,
    ``ValueError`` for a batch of trajectories.

    **Example:**

    >>> import tempfile
    >>> from jaxball import Disk, DiskState, load_run, save, simulate
    >>> run = simulate(Disk(mass=1.0, inertia=0.5), [0.0, 1.0, 2.0], DiskState(phidot=-1.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = save(run, f"{folder}/run.npz")
    ...     again = load_run(path)
    >>> path.name, bool((again.state.z == run.state.z).all())
    ('run.npz', True)
    """
    path = Path(path)
    check_destination(path, SUFFIXES)
    with replacing(path) as beside:
        WRITERS[path.suffix](trajectory, beside, scenario)
    return path


def _write_netcdf(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None) -> None:
    to_dataset(trajectory, scenario).to_netcdf(path, engine="h5netcdf")


def _write_npz(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None) -> None:
    arrays: dict[str, Any] = {"time": np.asarray(trajectory.times)}
    arrays |= {name: array for name, (_, array) in values(trajectory).items()}
    arrays |= {name: np.asarray(value) for name, value in attributes(trajectory, scenario).items()}
    np.savez_compressed(path, **arrays)


def _write_csv(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None) -> None:
    columns = {"time": np.asarray(trajectory.times)}
    for name, (_, array) in values(trajectory).items():
        for entry, index in entries(name, array.shape[1:]).items():
            columns[entry] = array[(slice(None), *index)]
    columns["status"] = np.full(columns["time"].shape, int(trajectory.status))
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")


WRITERS: dict[str, Callable[[Trajectory[Any, Any], Path, Scenario | None], None]] = {
    ".nc": _write_netcdf,
    ".npz": _write_npz,
    ".csv": _write_csv,
}
SUFFIXES = tuple(WRITERS)
