"""Points of a study that a CSV or Parquet file lists."""

import functools
import hashlib
from pathlib import Path

import numpy as np

from .errors import StudyError


def read_points(path: Path) -> tuple[tuple[str, ...], str, int]:
    """The names of a file's columns, the SHA-256 of its bytes, and how many rows it has.

    **Raises:** :class:`StudyError` when it cannot be read, or holds something other than numbers.
    """
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise StudyError(
            f'Key `points` must be a file that can be read, but "{path}" cannot: {error.strerror}.'
        ) from None
    names, table = _table(path, digest)
    return names, digest, len(table)


def points(path: Path, digest: str, indices: np.ndarray) -> np.ndarray:
    """The rows ``indices`` of a file, which must be as it was when the study was read."""
    return _table(path, digest)[1][indices]


@functools.lru_cache(maxsize=4)
def _table(path: Path, digest: str) -> tuple[tuple[str, ...], np.ndarray]:
    # Imported here, because it belongs to the extra `sweep`.
    import pyarrow.csv
    import pyarrow.parquet

    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        raise StudyError(
            f'Key `points` must be a file that does not change while a study runs, but "{path}" has changed.'
        )
    if path.suffix not in (".csv", ".parquet"):
        raise StudyError(f'Key `points` must be a .csv or .parquet file, but it is "{path}".')
    try:
        read = pyarrow.csv.read_csv if path.suffix == ".csv" else pyarrow.parquet.read_table
        table = read(pyarrow.BufferReader(content))
    except (ValueError, OSError) as error:
        raise StudyError(f'Key `points` must be a table, but "{path}" is not: {error}.') from None
    for field in table.schema if table.num_rows else ():
        if not (pyarrow.types.is_integer(field.type) or pyarrow.types.is_floating(field.type)):
            raise StudyError(
                f'Column `{field.name}` of "{path}" must contain only numbers, but it contains {field.type}.'
            )
    columns = [np.asarray(column.to_numpy(), dtype=float) for column in table.columns]
    return tuple(table.column_names), np.stack(columns, axis=1)
