"""Files that are there whole or not at all."""

import contextlib
import os
import re
import shutil
import socket
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

SECONDS_OF_A_PART = 24 * 3600.0
_PART = re.compile(r"\.part-(?P<machine>.+)-(?P<process>\d+)-[^-]+")


def part_prefix() -> str:
    """How the names begin of files and folders that this process has not finished: they say whose they are."""
    return f".part-{_machine()}-{os.getpid()}-"


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A file to write, beside ``path``; at the end it is on the disk and moved there, unless something was raised.

    A process that is killed on the way leaves ``path`` as it was, and a file whose name begins with ``.part-``.
    """
    handle, name = tempfile.mkstemp(prefix=part_prefix(), dir=path.parent)
    os.close(handle)
    beside = Path(name)
    try:
        yield beside
        _flush(beside)
        beside.chmod(0o666 & ~_umask())
        beside.replace(path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def write_whole(path: Path, content: bytes) -> None:
    """Writes a file, whole or not at all. Its folder is made where it does not exist."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole(path) as beside:
        beside.write_bytes(content)


def flush_folder(path: Path) -> None:
    """Waits until the names of a folder's files are on the disk."""
    _flush(path)


def remove_parts(folder: Path) -> None:
    """Removes what killed processes left."""
    for path in folder.rglob(".part-*"):
        path.unlink(missing_ok=True)


def remove_dead_parts(folder: Path) -> None:
    """Removes what killed processes left in ``folder`` itself, where others may be at work.

    A process of this machine is known to be dead. Those of others are not, and what they left is removed when it is
    older than a day. What cannot be removed stays.
    """
    with contextlib.suppress(OSError):
        for path in folder.glob(".part-*"):
            if _is_dead(path):
                _remove(path)


def _is_dead(path: Path) -> bool:
    named = _PART.fullmatch(path.name)
    if named is None:
        return False
    if named["machine"] == _machine() and not _is_running(int(named["process"])):
        return True
    with contextlib.suppress(OSError):
        return time.time() - path.stat().st_mtime > SECONDS_OF_A_PART
    return False


def _machine() -> str:
    """Where the number of a process says which it is: the machine and, on Linux, the namespace of the numbers."""
    namespace = Path("/proc/self/ns/pid")
    return f"{socket.gethostname()}-{namespace.stat().st_ino if namespace.exists() else 0}"


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # it is another user's
        return True
    return True


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
