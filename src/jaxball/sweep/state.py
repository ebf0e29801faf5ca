"""How far a store has come, read from the store alone."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..scenario import ScenarioError, read_document
from ..status import Status
from .attributes import read_attributes
from .errors import StoreError
from .numbers import with_numbers
from .store import MARKS


def describe(folder: str | Path) -> str:
    """How many rows of a store are done, with which statuses, and what is wrong with the first row that failed.

    **Raises:** :class:`StoreError` when ``folder`` is not the store of a study.
    """
    folder = Path(folder)
    attributes = read_attributes(folder)
    rows, chunk = attributes["rows"], attributes["chunk"]
    done = sorted(int(path.name) for path in (folder / MARKS).iterdir() if path.name.isdigit())
    counts, first = np.zeros(len(Status), dtype=int), None
    for k in done:
        status = _column(folder, "status", k, np.dtype(np.int8))[: rows - k * chunk]
        counts += np.bincount(status, minlength=len(Status))
        failed = np.flatnonzero(status)
        if first is None and failed.size:
            first = k, int(failed[0]), Status(int(status[failed[0]]))
    lines = [attributes["title"]] if attributes["title"] else []
    total = int(counts.sum())
    lines.append(f"{total:,} of {rows:,} rows are done ({100 * total / rows:.1f} %)")
    lines += [f"  {int(counts[status]):,} {status.name}" for status in Status if counts[status]]
    if first is not None:
        lines.append(_first_failure(folder, attributes, *first))
    return "\n".join(lines)


def _first_failure(folder: Path, attributes: Mapping[str, Any], chunk: int, place: int, status: Status) -> str:
    values = {path: float(_column(folder, path, chunk, np.dtype("<f8"))[place]) for path in attributes["paths"]}
    shown = ", ".join(f"{path} = {value:.6g}" for path, value in values.items())
    line = f"  the first to fail is row {chunk * attributes['chunk'] + place}, {status.name}, with {shown}"
    try:
        read_document(with_numbers(tomllib.loads(attributes["scenario"]), values))
    except ScenarioError as error:
        line += f"\n  {error}"
    return line


def _column(folder: Path, name: str, chunk: int, dtype: np.dtype) -> np.ndarray:
    path = folder / name / "c" / str(chunk)
    try:
        return np.frombuffer(path.read_bytes(), dtype)
    except (OSError, ValueError):
        raise StoreError(f'The file "{path}" must hold numbers, but something has changed it.') from None
