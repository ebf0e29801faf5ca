"""The flat table of a study: a Parquet file with a row for each run."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..interface.output import atomic_write, flush_to_disk
from ..scenario.paths import entries
from .errors import StoreError
from .outputs import Output
from .store import Store

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
            pyarrow.field(name, pyarrow.from_numpy_dtype(store.outputs[source].dtype))
            for name, (source, _) in columns.items()
        ]
    )
    together = max(1, ROWS_OF_A_GROUP // store.study.chunk)
    try:
        # The file is opened here, because pyarrow accepts no name that is not valid text.
        with (
            atomic_write(store.table, flush=True) as beside,
            beside.open("wb") as file,
            pyarrow.parquet.ParquetWriter(file, schema) as writer,
        ):
            for start in range(0, store.study.chunks, together):
                chunks = range(start, min(start + together, store.study.chunks))
                writer.write_table(pyarrow.table(_group(store, columns, chunks), schema=schema))
        flush_to_disk(store.table.parent)
    except OSError as error:
        raise StoreError(
            f'The table "{store.table}" cannot be written: {error.strerror or error}. The store is intact; free some '
            "space, and run the same command again."
        ) from error


def _columns(outputs: dict[str, Output]) -> Iterator[tuple[str, tuple[str, tuple[Any, ...]]]]:
    """The name of each column, with its variable and the index in it."""
    for name, output in outputs.items():
        if name == "time":
            continue
        saved = output.dimensions[:1] == ("save",)
        for entry, index in entries(name, output.shape[saved:]).items():
            yield entry, (name, (slice(None), *[-1] * saved, *index))


def _group(store: Store, columns: dict[str, Any], chunks: range) -> dict[str, np.ndarray]:
    arrays = {
        name: np.concatenate([store.read(name, chunk) for chunk in chunks])
        for name in dict.fromkeys(source for source, _ in columns.values())
    }
    return {name: np.ascontiguousarray(arrays[source][place]) for name, (source, place) in columns.items()}


def has_table(store: Store) -> bool:
    """Whether the table exists."""
    return store.table.exists()
