"""The store of a study: a Zarr group that xarray opens, each of its chunks written atomically, and its flat table.

The arrays are not compressed, so that a chunk of an array is a file of its numbers and their checksum, which can be
written to a temporary file and moved into place. When all files of a chunk of rows are on disk, a mark says so; rows
without a mark are computed again.
"""

import contextlib
import errno
import functools
import importlib.metadata
import json
import os
import shutil
import subprocess
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...files.scenario.paths import entries
from ...interface import interruption
from ...interface.output import atomic_write, flush_to_disk, part_prefix
from ...interface.status import Status
from .files import (
    MARKS,
    Damage,
    StoreError,
    damages,
    read_chunk,
    remove_dead_parts,
    with_checksum,
    write_atomically,
)
from .outputs import AXES, NAMES, OWN_UNITS, Output, dimensions, labels_of, layout_of
from .study import Study

PACKAGES = ("jaxball", "jax", "jaxlib", "diffrax", "numpy", "scipy")
LAYOUT = "5"  # increased when the layout of stores changes


def identity_of(study: Study) -> dict[str, str]:
    """Returns everything that the numbers in a store depend on, as attributes."""
    return {**study.identity(), **versions(), "layout": LAYOUT}


def read_attributes(folder: Path) -> dict[str, Any]:
    """Reads the attributes of a store.

    **Raises:** :class:`StoreError` when there is nothing at ``folder``, or something other than the store of a study,
    or one of another layout.
    """
    # `lexists`, because a broken link is something, too, and must not be overwritten.
    if not os.path.lexists(folder):
        raise StoreError(f'There must be the store of a study at "{folder}", but nothing is there.')
    try:
        attributes = json.loads((folder / "zarr.json").read_text(encoding="utf-8"))["attributes"]
    except (OSError, ValueError, KeyError, TypeError):
        attributes = None
    if not isinstance(attributes, dict) or not {"scenario", "axes", "settings"} <= attributes.keys():
        raise StoreError(f'"{folder}" must be the store of a study, but it is something else; it is left as it is.')
    if attributes.get("layout") != LAYOUT:
        raise StoreError(
            f'The store "{folder}" has the layout {attributes.get("layout")}, and this version reads {LAYOUT}; read it '
            "with the version that wrote it, or run the study into a new store."
        )
    return attributes


def versions() -> dict[str, str]:
    """Returns the version of each package, and the git commit of a working copy of jaxball, empty where there
    is none.
    """
    package_versions = {f"{name}_version": importlib.metadata.version(name) for name in PACKAGES}
    return package_versions | {"commit": _commit()}


def _commit() -> str:
    here = Path(__file__)
    try:
        # An installed package may lie within an unrelated repository, which does not track it.
        _git("ls-files", "--error-unmatch", here.name)
        return _git("rev-parse", "HEAD")
    except (OSError, subprocess.CalledProcessError):
        return ""


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


OF_STUDY = b"jaxball_study"  # in the metadata of a table, its study's identity
POINTS_TOGETHER = 2**20
# Otherwise Zarr would write no file where all numbers are 0, and a lost file would be read as zeros.
WRITTEN_EVEN_IF_ZERO: Any = {"write_empty_chunks": True}


class Store:
    """The folder of a study's results, which exists and belongs to the study."""

    def __init__(self, folder: Path, study: Study, outputs: dict[str, Output]):
        self.folder, self.study, self.outputs = folder, study, outputs

    @property
    def table(self) -> Path:
        """The Parquet table beside the store."""
        return self.folder.with_suffix(".parquet")

    def write(self, chunk: int, arrays: dict[str, np.ndarray]) -> None:
        """Writes all variables of a chunk, and then its mark.

        **Raises:** :class:`StoreError` when that fails; the chunk then has no mark.
        """
        # Every folder above a new file, because a name is on disk only when its folder is.
        folders = set()
        try:
            # Before any folder is made, which would take the place of a store that has been removed.
            self.folder.stat()
            for name, output in self.outputs.items():
                # All chunks of a Zarr array have the same shape; what is beyond the last row stays at the fill value.
                padded = output.empty(self.study.chunk)
                padded[: len(arrays[name])] = arrays[name]
                path = self._file(name, chunk)
                # Little-endian on any machine, as the metadata say.
                write_atomically(path, with_checksum(padded.astype(output.dtype.newbyteorder("<")).tobytes()))
                folders |= {folder for folder in path.parents if self.folder in folder.parents}
            # A mark must never appear before what it stands for. If the machine stops between the two, the chunk is
            # computed again; the other way round, lost numbers would count as done.
            for folder in folders:
                flush_to_disk(folder)
            write_atomically(self._mark(chunk), b"")
            flush_to_disk(self._mark(chunk).parent)
        except OSError as error:
            raise self._write_error(error) from error

    def _write_error(self, error: OSError) -> StoreError:
        if not self.folder.exists():
            return StoreError(
                f'The store "{self.folder}" must stay in its place while a sweep writes to it, but it has been removed '
                "or moved; put it back, or let the same command compute all rows again."
            )
        reason = f'The store "{self.folder}" cannot be written: {error.strerror or error}.'
        return StoreError(f"{reason} Its contents are intact; {remedy_of(error)}run the same command again.")

    def read(self, name: str, chunk: int) -> np.ndarray:
        """Reads a variable in the rows of a chunk that is done.

        **Raises:** :class:`StoreError` when its file has been changed from outside.
        """
        output = self.outputs[name]
        array = read_chunk(self._file(name, chunk), (self.study.chunk, *output.shape), output.dtype)
        return array[: len(self.study.rows_of(chunk))]

    def repair(self) -> list[Damage]:
        """Removes the marks of chunks with files that have been changed from outside, so that they are computed again.

        What is the same for all rows, metadata and the points of axes, is written again. Returns what was changed.

        **Raises:** :class:`StoreError` when that fails.
        """
        # It follows from the study alone, so that a new store has the same bytes.
        with _make_store(self, identity_of(self.study)) as blank_store:
            new = {
                self.folder / file.relative_to(blank_store): file for file in blank_store.rglob("*") if file.is_file()
            }
            changed = [
                path for path, file in new.items() if not (path.is_file() and path.read_bytes() == file.read_bytes())
            ]
            for path in changed:
                _require_no_folder(path)
                path.parent.mkdir(parents=True, exist_ok=True)
                new[path].replace(path)
        # All of them first, because marks that are removed change which chunks are checked.
        damaged = list(damages(self.folder))
        for damage in damaged:
            _require_no_folder(damage.path)
            if damage.chunk is not None:
                self._mark(damage.chunk).unlink(missing_ok=True)
        return [*damaged, *(Damage(path, None) for path in changed)]

    def _file(self, name: str, chunk: int) -> Path:
        zeros = ["0"] * len(self.outputs[name].shape)
        return self.folder.joinpath(name, "c", str(chunk), *zeros)

    def _mark(self, chunk: int) -> Path:
        return self.folder / MARKS / str(chunk)


def _require_no_folder(path: Path) -> None:
    if path.is_dir():
        raise StoreError(
            f'The file "{path}" must be as the sweep wrote it, but a folder is in its place; remove the folder, and '
            "run the same command again."
        )


def open_store(folder: Path, study: Study, outputs: dict[str, Output]) -> Store:
    """Opens the store of ``study`` at ``folder``, created if it does not exist.

    **Raises:** :class:`StoreError` when there is something else at that path, including the store of another study or
    of other versions, and when it cannot be created. Existing files are not changed.
    """
    if folder.suffix != ".zarr":
        raise StoreError(f'Argument `out` must end in .zarr, but it is "{folder}".')
    expected = identity_of(study)
    store = Store(folder, study, outputs)
    # A sweep that was killed while it made its store left a temporary folder beside it.
    remove_dead_parts(folder.parent)
    if not os.path.lexists(folder):
        if os.path.lexists(store.table):
            # Before the store is made: an error then leaves nothing behind.
            _check_table(store.table, expected)
        _create(store, expected)
    # Also of a store just made, since another shard may have made it, for another study.
    attributes = read_attributes(folder)
    differing = [name for name, value in expected.items() if attributes.get(name) != value]
    if differing:
        raise StoreError(
            f'The store "{folder}" belongs to another study, with other {", ".join(differing)}; it is left as it is. '
            "Choose another name, or remove it."
        )
    return store


def _check_table(table: Path, expected: dict[str, str]) -> None:
    """Raises a :class:`StoreError` unless a table without a store is that of the study, which is then kept."""
    # Imported here, because it belongs to the extra `sweep`.
    import pyarrow.parquet

    try:
        with table.open("rb") as file:
            metadata = pyarrow.parquet.read_schema(file).metadata or {}
        identity = json.loads(metadata.get(OF_STUDY, b"null"))
    except (OSError, ValueError):
        identity = None
    if identity == expected:
        return
    differing = [name for name, value in expected.items() if (identity or {}).get(name) != value]
    what = f"is of a study with other {', '.join(differing)}" if identity else "does not say of which study it is"
    raise StoreError(
        f'The table of the study would be "{table}", but there is such a file already, without its store, and it '
        f"{what}; choose another name for the store, or move the table."
    )


@contextlib.contextmanager
def _make_store(store: Store, attributes: dict[str, Any]) -> Iterator[Path]:
    """Makes a store without results, in a temporary folder beside it that is removed afterwards.

    **Raises:** :class:`StoreError` when it cannot be created.
    """
    folder = store.folder
    try:
        with (
            tempfile.TemporaryDirectory(prefix=part_prefix(), dir=folder.parent) as beside,
            # A signal ends the process without leaving this block, which would remove the folder.
            interruption.on_interrupt(lambda: shutil.rmtree(beside)),
        ):
            blank_store = Path(beside) / "store"
            _write_metadata(blank_store, store.study, store.outputs, attributes)
            (blank_store / MARKS).mkdir()
            yield blank_store
        # The name of the new store is an entry of this folder.
        flush_to_disk(folder.parent)
    except OSError as error:
        raise StoreError(
            f'Argument `out` must lie in a folder that can be written, but "{folder}" cannot be made: '
            f"{error.strerror or error}."
        ) from error


def _create(store: Store, attributes: dict[str, Any]) -> None:
    with _make_store(store, attributes) as blank_store:
        try:
            # The store appears whole, by one move: no other process can see it without its metadata.
            blank_store.rename(store.folder)
        except OSError:
            if not (store.folder / "zarr.json").exists():  # unless another shard was faster
                raise


def _write_metadata(folder: Path, study: Study, outputs: dict[str, Output], attributes: dict[str, Any]) -> None:
    # Imported here, because they belong to the extra `sweep`.
    import zarr

    template = study.template()
    solve = {name: getattr(template, name) for name in ("solver", "rtol", "atol", "max_steps")}
    about = {
        "title": study.title,
        **solve,
        "shape": list(study.shape),
        "paths": list(study.paths),
        "rows": study.rows,
        "chunk": study.chunk,
        **layout_of(study),
        "statuses": ", ".join(f"{item.value} {item.name}" for item in Status),
        "coordinates": " ".join(name for name, item in outputs.items() if item.coordinate and name != "row"),
    }
    group = zarr.open_group(folder, mode="w-", zarr_format=3, attributes={**about, **attributes})
    create = functools.partial(_create_array, group)
    for name, output in outputs.items():
        own_units = {OWN_UNITS: list(output.own_units)} if output.own_units else {}
        create(
            name,
            shape=(study.rows, *output.shape),
            chunks=(study.chunk, *output.shape),
            dtype=output.dtype,
            fill_value=output.fill,
            dimension_names=["row", *output.dimensions],
            attributes={"units": output.units, "long_name": output.meaning, **own_units},
        )
    for name, labels in labels_of(outputs, template).items():
        # There is no string type that every Zarr library reads.
        # Strings are stored as an attribute, and their numbers as the coordinate.
        texts = labels.dtype.kind == "U"
        create(
            name,
            data=np.arange(len(labels)) if texts else labels,
            dimension_names=[name],
            config=WRITTEN_EVEN_IF_ZERO,
            attributes={NAMES: labels.tolist()} if texts else {},
        )
    _write_points(group.create_group(AXES), study, dimensions(about["paths"], about["path_axis"]))
    with warnings.catch_warnings():
        # zarr warns that consolidated metadata are not yet in the standard; without them xarray warns.
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(folder)


def _create_array(group: Any, name: str, **settings: Any) -> Any:
    """Creates an array whose files are its numbers and their checksum."""
    from zarr.codecs import Crc32cCodec

    return group.create_array(name, filters=None, compressors=Crc32cCodec(), **settings)


def _write_points(group: Any, study: Study, names: list[str]) -> None:
    """Writes the values along each axis, which the finished rows may not cover yet."""
    for name, axis in zip(names, study.axes, strict=True):
        chunks = (min(axis.size, POINTS_TOGETHER),)
        arrays = [
            _create_array(
                group,
                path,
                shape=(axis.size,),
                chunks=chunks,
                dtype="f8",
                dimension_names=[name],
                config=WRITTEN_EVEN_IF_ZERO,
            )
            for path in axis.paths
        ]
        for start in range(0, axis.size, POINTS_TOGETHER):
            some = np.arange(start, min(start + POINTS_TOGETHER, axis.size))
            for array, values in zip(arrays, axis.values(some).T, strict=True):
                array[start : start + POINTS_TOGETHER] = values


ROWS_OF_A_GROUP = 2**16


def write_table(store: Store) -> None:
    """Writes the table of a store whose chunks are all done; states are those at the end of each run.

    Its bytes depend only on the store. At most one group of its rows is in memory.

    **Raises:** :class:`StoreError` when it cannot be written; an existing table is then unchanged.
    """
    # Imported here, because it belongs to the extra `sweep`.
    import pyarrow
    import pyarrow.parquet

    columns = dict(_columns(store.outputs))
    schema = pyarrow.schema(
        [
            pyarrow.field(
                name, pyarrow.from_numpy_dtype(store.outputs[source].dtype), metadata=_unit_of(store, source, place)
            )
            for name, (source, place) in columns.items()
        ],
        metadata={OF_STUDY: json.dumps(identity_of(store.study))},
    )
    # Groups of one chunk would make a large table slow to read, and the whole table at once may not fit in memory.
    per_group = max(1, ROWS_OF_A_GROUP // store.study.chunk)
    try:
        # The file is opened here, because pyarrow accepts no name that is not valid text.
        with (
            atomic_write(store.table, flush=True) as beside,
            beside.open("wb") as file,
            pyarrow.parquet.ParquetWriter(file, schema) as writer,
        ):
            for start in range(0, store.study.chunks, per_group):
                chunks = range(start, min(start + per_group, store.study.chunks))
                writer.write_table(pyarrow.table(_group(store, columns, chunks), schema=schema))
        flush_to_disk(store.table.parent)
    except OSError as error:
        raise StoreError(
            f'The table "{store.table}" cannot be written: {error.strerror or error}. The store is intact; '
            f"{remedy_of(error)}run the same command again."
        ) from error


def remedy_of(error: OSError) -> str:
    """Returns what to do before the next attempt, as the beginning of a clause; empty where nothing is known."""
    return "free some space, and " if error.errno in NO_SPACE else ""


NO_SPACE = {getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EFBIG") if hasattr(errno, name)}


def _unit_of(store: Store, name: str, index: tuple[Any, ...]) -> dict[str, str] | None:
    """Returns the metadata of a column, a variable at an index: its unit, if the scenario states units."""
    output = store.outputs[name]
    units = output.own_units[index[-1]] if output.own_units else output.units
    return {"units": units} if units and "units" in store.study.document else None


def _columns(outputs: dict[str, Output]) -> Iterator[tuple[str, tuple[str, tuple[Any, ...]]]]:
    """Lists the name of each column, with its variable and the index in it."""
    for name, output in outputs.items():
        # The same times for each row would be repeated in each row.
        if name == "time":
            continue
        saved = output.dimensions[:1] == ("save",)
        for entry, index in entries(name, output.shape[saved:]).items():
            # Where states are saved at several times, the last one.
            yield entry, (name, (slice(None), *[-1] * saved, *index))


def _group(store: Store, columns: dict[str, Any], chunks: range) -> dict[str, np.ndarray]:
    arrays = {
        name: np.concatenate([store.read(name, chunk) for chunk in chunks])
        for name in dict.fromkeys(source for source, _ in columns.values())
    }
    return {name: np.ascontiguousarray(arrays[source][place]) for name, (source, place) in columns.items()}
