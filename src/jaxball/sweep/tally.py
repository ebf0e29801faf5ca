"""The outcomes of the rows in a store."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from ..interface.status import Status
from .attributes import read_attributes
from .whole import STATUS, changed, check_whole, done, numbers_of


class Tally(NamedTuple):
    """How many rows of a store have each status, and the first one that failed, if one did."""

    counts: Int[np.ndarray, " statuses"]
    first: int | None

    @property
    def rows(self) -> int:
        """How many rows are done."""
        return int(self.counts.sum())

    @property
    def failed(self) -> int:
        """How many of them have a status other than SUCCESS."""
        return self.rows - int(self.counts[Status.SUCCESS])


def tally(folder: Path) -> Tally:
    """The outcomes of the rows that are done.

    **Raises:** :class:`StoreError` when ``folder`` is not the store of a study, and when a file of it has been changed
    from outside; of the numbers, only the statuses are read.
    """
    attributes = read_attributes(folder)
    check_whole(folder, numbers=False)
    rows, size = attributes["rows"], attributes["chunk"]
    counts, first = np.zeros(len(Status), dtype=int), None
    for chunk in done(folder):
        status = column(folder, "status", chunk, size, STATUS)[: rows - chunk * size]
        if not np.all((status >= 0) & (status < len(Status))):  # as a store of an earlier version may have them
            raise changed(folder / "status" / "c" / str(chunk))
        counts += np.bincount(status, minlength=len(Status))
        if first is None and np.any(status):
            first = chunk * size + int(np.argmax(status != Status.SUCCESS))
    return Tally(counts, first)


def column(folder: Path, name: str, chunk: int, rows: int, dtype: np.dtype) -> np.ndarray:
    """A variable with one number per row, in the ``rows`` of a chunk that is done; the last one has padding.

    **Raises:** :class:`StoreError` when its file has been changed from outside.
    """
    path = folder / name / "c" / str(chunk)
    content = path.read_bytes() if path.is_file() else b""
    if len(content) == rows * dtype.itemsize:  # a store of an earlier version
        return np.frombuffer(content, dtype)
    numbers = numbers_of(path, rows * dtype.itemsize)
    if numbers is None:
        raise changed(path)
    return np.frombuffer(numbers, dtype)
