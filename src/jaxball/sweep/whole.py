"""Finds files of a store that have been changed from outside, by their sizes."""

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..interface.status import Status
from .errors import StoreError

MARKS = ".done"  # the folder with a mark for each chunk whose files have been written
STATUS = np.dtype(np.int8)


class Damage(NamedTuple):
    """A file that is not as it was written, and its chunk of rows; None if it belongs to no chunk."""

    path: Path
    chunk: int | None


def done(folder: Path) -> list[int]:
    """The chunks that have been written, in order."""
    marks = folder / MARKS
    return sorted(int(path.name) for path in marks.iterdir() if path.name.isdigit()) if marks.is_dir() else []


def damages(folder: Path) -> Iterator[Damage]:
    """The files of the store at ``folder`` that have been changed from outside, in chunks that were written."""
    chunks = set(done(folder))
    for name, metadata in _nodes(folder).items():
        about = folder / name / "zarr.json"
        if not _says(about, metadata):
            yield Damage(about, None)
    for name, array in _arrays(folder).items():
        size = _size(array)
        for place in () if size is None else _places(array):
            path = folder.joinpath(name, "c", *map(str, place))
            if array["dimension_names"][0] != "row":
                if not path.is_file() or path.stat().st_size != size:
                    yield Damage(path, None)
            elif place[0] in chunks:
                rows = array["shape"][0] - place[0] * _chunk(array)[0]
                whole = path.is_file() and path.stat().st_size == size
                if not whole or (name == "status" and not _are_statuses(path, rows)):
                    yield Damage(path, place[0])


def check_whole(folder: Path) -> None:
    """Raises a :class:`StoreError` where a file of a store has been changed from outside."""
    for damage in damages(folder):
        raise changed(damage.path)


def changed(path: Path) -> StoreError:
    """The error for a file that has been changed from outside."""
    return StoreError(
        f'The file "{path}" must be as the sweep wrote it, but something has changed it; run the study into the same '
        "store again to recompute it."
    )


def _arrays(folder: Path) -> Mapping[str, Any]:
    """The metadata of each array, by its path in the store."""
    return {name: one for name, one in _nodes(folder).items() if one.get("node_type") == "array"}


def _nodes(folder: Path) -> Mapping[str, Any]:
    """The metadata of each array and of each group in the store, by its path."""
    about = json.loads((folder / "zarr.json").read_text(encoding="utf-8"))
    return about.get("consolidated_metadata", {}).get("metadata", {})


def _says(path: Path, metadata: Mapping[str, Any]) -> bool:
    """Whether the metadata file of an array or a group agrees with the store's, which Zarr reads instead."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return found == {name: value for name, value in metadata.items() if name != "consolidated_metadata"}


def _size(array: Mapping[str, Any]) -> int | None:
    """How many bytes each file of an array has; None where that depends on its content."""
    if [codec["name"] for codec in array["codecs"]] != ["bytes"]:
        return None
    kind = array["data_type"]
    size = np.dtype(kind).itemsize if isinstance(kind, str) else kind["configuration"].get("length_bytes")
    return None if size is None else size * math.prod(_chunk(array))


def _places(array: Mapping[str, Any]) -> list[tuple[int, ...]]:
    counts = (-(-size // chunk) for size, chunk in zip(array["shape"], _chunk(array), strict=True))
    return list(np.ndindex(*counts))


def _chunk(array: Mapping[str, Any]) -> list[int]:
    return array["chunk_grid"]["configuration"]["chunk_shape"]


def _are_statuses(path: Path, rows: int) -> bool:
    """Whether the numbers in the file are those of a status in each of so many rows, or fewer if it has fewer."""
    status = np.frombuffer(path.read_bytes(), STATUS)[:rows]
    return bool(np.all((status >= 0) & (status < len(Status))))
