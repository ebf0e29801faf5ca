"""Locks, by which two processes never compute the same part of a study at the same time."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from .progress import Stream

WAITING = "Another process is at work on this part of the study; waiting until it ends.\n"


@contextlib.contextmanager
def only_one(store: Path, shard: tuple[int, int], stream: Stream) -> Iterator[None]:
    """Runs the block when no other process is in such a block for the same store and shard, which ``stream`` is told.

    The system releases the lock of a process that is killed. Where a file system has no locks there are none: two
    processes then compute the same rows, and write the same files.
    """
    # Imported here, because it belongs to the extra `sweep`.
    import filelock

    # Beside the store, whose files are the same whatever wrote them.
    path = store.with_name(f".lock-{store.name}-{shard[0]}-{shard[1]}")
    lock = filelock.FileLock(path)
    with contextlib.suppress(OSError, NotImplementedError):
        try:
            lock.acquire(timeout=0)
        except filelock.Timeout:
            stream.write(WAITING)
            lock.acquire()
    try:
        yield
    finally:
        if lock.is_locked:
            with contextlib.suppress(OSError):
                path.unlink()  # whoever waits for it has it open, and finds all rows done
        lock.release()
