"""The files of a store: written atomically, with checksums that show what was changed from outside."""

import contextlib
import json
import math
import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...files.scenario.errors import ScenarioError
from ...interface.output import OutputError, atomic_write, machine


class StudyError(ScenarioError):
    """A study cannot be read; the message is one sentence that names the key or the row."""


class StoreError(OutputError):
    """A store cannot be written or does not belong to the study; the message is one sentence that names it."""


class WorkerError(RuntimeError):
    """A worker ended before its chunk did."""


SECONDS_OF_A_PART = 24 * 3600.0
_PART = re.compile(r"\.part-(?P<machine>.+)-(?P<process>\d+)-[^-]+")


def write_atomically(path: Path, content: bytes) -> None:
    """Writes a file atomically. Its folder is created if it does not exist."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # Flushed, because only its name would be certain otherwise, and its contents might be lost.
    with atomic_write(path, flush=True) as beside:
        beside.write_bytes(content)


def remove_dead_parts(folder: Path, *, everywhere: bool = False) -> None:
    """Removes what killed processes left in ``folder`` itself or, ``everywhere``, also below it; others may be running.

    Whether a process of this machine is dead is known. For other machines it is not, and their files are removed when
    older than a day. Files that cannot be removed stay.
    """
    with contextlib.suppress(OSError):
        for path in list((folder.rglob if everywhere else folder.glob)(".part-*")):
            if _is_dead(path):
                _remove(path)


def _is_dead(path: Path) -> bool:
    named = _PART.fullmatch(path.name)
    if named is None:
        return False
    if named["machine"] == machine() and not is_running(int(named["process"])):
        return True
    with contextlib.suppress(OSError):
        return time.time() - path.stat().st_mtime > SECONDS_OF_A_PART
    return False


def is_running(process: int) -> bool:
    """Returns whether a process of this machine is running."""
    # Imported here, because it belongs to the extra `sweep`. On Windows `os.kill` would end the process, or, as
    # Ctrl-C, all those of its console.
    import psutil

    return psutil.pid_exists(process)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()


MARKS = ".done"  # the folder with a mark for each chunk whose files have been written
STATUS = np.dtype(np.int8)
BYTES_OF_A_CHECKSUM = 4


class Damage(NamedTuple):
    """A file that is not as it was written, and its chunk of rows; None if it is the same for all rows."""

    path: Path
    chunk: int | None


def list_chunks(folder: Path) -> list[int]:
    """Lists the chunks that have been written, in order."""
    marks = folder / MARKS
    return sorted(int(path.name) for path in marks.iterdir() if path.name.isdigit()) if marks.is_dir() else []


def with_checksum(content: bytes) -> bytes:
    """Returns the numbers of a chunk as its file holds them."""
    # Imported here, because it belongs to the extra `sweep`.
    import google_crc32c

    # In the form of Zarr's codec `crc32c`, which checks it when the array is read.
    return content + google_crc32c.value(content).to_bytes(BYTES_OF_A_CHECKSUM, "little")


def numbers_of(path: Path, size: int) -> bytes | None:
    """Reads the numbers in a file of ``size`` bytes that ends with their checksum; None if it has been changed."""
    content = path.read_bytes() if path.is_file() else b""
    numbers = content[:-BYTES_OF_A_CHECKSUM]
    return numbers if len(numbers) == size and content == with_checksum(numbers) else None


def read_chunk(path: Path, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Reads the numbers of a variable in the rows of a chunk that is done; the last one has padding.

    **Raises:** :class:`StoreError` when its file has been changed from outside.
    """
    numbers = numbers_of(path, math.prod(shape) * dtype.itemsize)
    if numbers is None:
        # None of it is used: one wrong number says that something else wrote to the file.
        raise change_error(path)
    return np.frombuffer(numbers, dtype.newbyteorder("<")).reshape(shape)


def damages(folder: Path, *, numbers: bool = True) -> Iterator[Damage]:
    """Lists the files of numbers in the store at ``folder`` that have been changed from outside, in chunks that were
    written.

    With ``numbers`` all files are read; otherwise only their sizes are checked.
    """
    chunks = set(list_chunks(folder))
    metadata = folder / "zarr.json"
    nodes = json.loads(metadata.read_text(encoding="utf-8")).get("consolidated_metadata", {}).get("metadata", {})
    if not nodes:
        yield Damage(metadata, None)
    for name, array in nodes.items():
        if array["node_type"] != "array":
            continue
        shape = array["chunk_grid"]["configuration"]["chunk_shape"]
        size = np.dtype(array["data_type"]).itemsize * math.prod(shape)
        of_rows = array["dimension_names"][0] == "row"
        for place in np.ndindex(*(-(-rows // at_once) for rows, at_once in zip(array["shape"], shape, strict=True))):
            path = folder.joinpath(name, "c", *map(str, place))
            if of_rows and place[0] not in chunks:
                continue
            same_size = path.is_file() and path.stat().st_size == size + BYTES_OF_A_CHECKSUM
            if not (numbers_of(path, size) is not None if numbers else same_size):
                yield Damage(path, place[0] if of_rows else None)


def check_intact(folder: Path, *, numbers: bool = True) -> None:
    """Raises a :class:`StoreError` where a file of a store has been changed from outside, see :func:`damages`."""
    for damage in damages(folder, numbers=numbers):
        raise change_error(damage.path)


def change_error(path: Path) -> StoreError:
    """Makes the error for a file that has been changed from outside."""
    return StoreError(
        f'The file "{path}" must be as the sweep wrote it, but something has changed it; run the study into the same '
        "store again to recompute it."
    )
