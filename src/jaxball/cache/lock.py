"""A lock file that one process holds at a time; the operating system releases it when the process ends in any way."""

import contextlib
import os
import time
from collections.abc import Iterator
from pathlib import Path

SECONDS_BETWEEN_LOOKS = 0.02

if os.name == "nt":
    import msvcrt

    def _hold(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # pyright: ignore[reportAttributeAccessIssue]
else:
    import fcntl

    def _hold(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextlib.contextmanager
def held(path: Path, patience: float) -> Iterator[None]:
    """Waits until no other process holds the file, ``patience`` seconds at most, and holds it in this block.

    Where files cannot be created or locked, it does not wait.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o600)
    except OSError:
        yield
        return
    deadline = time.monotonic() + patience
    try:
        while time.monotonic() < deadline:
            try:
                _hold(descriptor)
                break
            except (BlockingIOError, PermissionError):
                time.sleep(SECONDS_BETWEEN_LOOKS)
            except OSError:
                break
        yield
    finally:
        with contextlib.suppress(OSError):  # for instance if another process has it open on Windows
            path.unlink()
        os.close(descriptor)
