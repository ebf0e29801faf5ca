"""Finds files of a store that have been changed from outside.

Each file of an array ends with the CRC-32C of its numbers, which Zarr's codec of that name checks when it reads them.
Stores of earlier versions have none, and their files are checked by their sizes alone.
"""

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .errors import StoreError

MARKS = ".done"  # the folder with a mark for each chunk whose files have been written
STATUS = np.dtype(np.int8)
CHECKSUM = "crc32c"
BYTES_OF_A_CHECKSUM = 4


class Damage(NamedTuple):
    """A file that is not as it was written, and its chunk of rows; None if it belongs to no chunk."""

    path: Path
    chunk: int | None


def done(folder: Path) -> list[int]:
    """The chunks that have been written, in order."""
    marks = folder / MARKS
    return sorted(int(path.name) for path in marks.iterdir() if path.name.isdigit()) if marks.is_dir() else []


def with_checksum(content: bytes) -> bytes:
    """The numbers of a chunk as its file holds them."""
    return content + _checksum(content)


def numbers_of(path: Path, size: int) -> bytes | None:
    """The numbers in a file that ends with their checksum, in so many bytes; None if it has been changed."""
    content = path.read_bytes() if path.is_file() else b""
    numbers = content[:-BYTES_OF_A_CHECKSUM]
    return numbers if len(numbers) == size and content == with_checksum(numbers) else None


def damages(folder: Path, *, numbers: bool = True) -> Iterator[Damage]:
    """The files of the store at ``folder`` that have been changed from outside, in chunks that were written.

    With ``numbers`` all files are read; otherwise only their sizes are checked.
    """
    chunks = set(done(folder))
    for name, metadata in _nodes(folder).items():
        about = folder / name / "zarr.json"
        if not _says(about, metadata):
            yield Damage(about, None)
    for name, array in _arrays(folder).items():
        size, has_checksum = _size(array), CHECKSUM in _codecs(array)
        if size is None:
            continue
        whole = _is_whole if numbers and has_checksum else _is_of_its_size
        size += BYTES_OF_A_CHECKSUM * has_checksum
        for place in _places(array):
            path = folder.joinpath(name, "c", *map(str, place))
            chunk = place[0] if array["dimension_names"][0] == "row" else None
            if (chunk is None or chunk in chunks) and not whole(path, size):
                yield Damage(path, chunk)


def check_whole(folder: Path, *, numbers: bool = True) -> None:
    """Raises a :class:`StoreError` where a file of a store has been changed from outside, see :func:`damages`."""
    for damage in damages(folder, numbers=numbers):
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
    """How many bytes the numbers in each file of an array have; None where that depends on their values."""
    if not {"bytes"} <= set(_codecs(array)) <= {"bytes", CHECKSUM}:
        return None
    kind = array["data_type"]
    size = np.dtype(kind).itemsize if isinstance(kind, str) else kind["configuration"].get("length_bytes")
    return None if size is None else size * math.prod(_chunk(array))


def _codecs(array: Mapping[str, Any]) -> list[str]:
    return [codec["name"] for codec in array["codecs"]]


def _places(array: Mapping[str, Any]) -> list[tuple[int, ...]]:
    counts = (-(-size // chunk) for size, chunk in zip(array["shape"], _chunk(array), strict=True))
    return list(np.ndindex(*counts))


def _chunk(array: Mapping[str, Any]) -> list[int]:
    return array["chunk_grid"]["configuration"]["chunk_shape"]


def _is_of_its_size(path: Path, size: int) -> bool:
    return path.is_file() and path.stat().st_size == size


def _is_whole(path: Path, size: int) -> bool:
    return numbers_of(path, size - BYTES_OF_A_CHECKSUM) is not None


def _checksum(content: bytes) -> bytes:
    # Imported here, because it belongs to the extra `sweep`.
    import google_crc32c

    return google_crc32c.value(content).to_bytes(BYTES_OF_A_CHECKSUM, "little")
