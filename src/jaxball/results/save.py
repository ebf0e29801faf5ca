"""Saving a trajectory to a file."""

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..scenario import Scenario
from ..trajectory import Trajectory
from .dataset import to_dataset
from .provenance import attributes
from .variables import COORDINATES, values


class OutputError(ValueError):
    """A file cannot be written; the message is one sentence that names it."""


def save(trajectory: Trajectory[Any, Any], path: str | Path, scenario: Scenario | None = None) -> Path:
    """Saves a trajectory with all its observables, or laws, in the format that the suffix of ``path`` names.

    - ``.nc``: netCDF, see :func:`to_dataset`; ``xarray.open_dataset(path)`` reads it.
    - ``.npz``: the same arrays, and the attributes as texts and numbers.
    - ``.csv``: a row for each time and a column for each number, named as ``Omega_1`` or
      ``mass_positions_body_0_3`` (mass 0, axis 3); the column ``status`` is 0 for a solve that
      reached its end, and the number of its :class:`~jaxball.Status` for one that failed.

    A failed solve is saved too, with its status, and NaN after the time that it reached. The file is
    written beside ``path`` and then moved there, so a failure never harms a file that exists.

    **Returns:** ``path``.

    **Raises:** :class:`OutputError` when the suffix is another one, or the file cannot be written,
    ``ValueError`` for a batch of trajectories.
    """
    path = Path(path)
    check_destination(path)
    with replacing(path) as beside:
        WRITERS[path.suffix](trajectory, beside, scenario)
    return path


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to, beside ``path``; what is there at the end is moved to ``path``.

    **Raises:** :class:`OutputError` when the file cannot be written; ``path`` is then as it was.
    """
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".jaxball-") as folder:
            beside = Path(folder) / path.name
            yield beside
            os.replace(beside, path)
    except OSError as error:
        raise OutputError(
            f'Argument `path` must be a file that can be written, but "{path}" is not: {error}.'
        ) from error


def check_destination(path: Path, suffixes: tuple[str, ...] | None = None) -> None:
    """Raises an :class:`OutputError` unless a file with one of ``suffixes`` can be written at ``path``."""
    suffixes = tuple(WRITERS) if suffixes is None else suffixes
    if path.suffix not in suffixes:
        raise OutputError(f'Argument `path` must end in one of {", ".join(suffixes)}, but it is "{path}".')
    if path.is_dir():
        raise OutputError(f'Argument `path` must be a file, but "{path}" is a folder.')
    if not path.parent.is_dir():
        raise OutputError(
            f'Argument `path` must lie in a folder that exists, but "{path.parent}" does not; make it first.'
        )
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise OutputError(f'Argument `path` must lie in a folder that can be written, but "{path.parent}" cannot.')


def _write_netcdf(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None) -> None:
    to_dataset(trajectory, scenario).to_netcdf(path, engine="h5netcdf")


def _write_npz(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None) -> None:
    arrays: dict[str, Any] = {"time": np.asarray(trajectory.times)}
    arrays |= {name: array for name, (_, array) in values(trajectory).items()}
    arrays |= {name: np.asarray(value) for name, value in attributes(trajectory, scenario).items()}
    np.savez_compressed(path, **arrays)


def _write_csv(trajectory: Trajectory[Any, Any], path: Path, scenario: Scenario | None) -> None:
    columns = {"time": np.asarray(trajectory.times)}
    for name, (variable, array) in values(trajectory).items():
        for index in np.ndindex(array.shape[1:]):
            labels = [
                COORDINATES[dimension][k] if dimension in COORDINATES else str(k)
                for dimension, k in zip(variable.dimensions, index, strict=True)
            ]
            columns["_".join([name, *labels])] = array[(slice(None), *index)]
    columns["status"] = np.full(columns["time"].shape, int(trajectory.status))
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")


WRITERS: dict[str, Callable[[Trajectory[Any, Any], Path, Scenario | None], None]] = {
    ".nc": _write_netcdf,
    ".npz": _write_npz,
    ".csv": _write_csv,
}
