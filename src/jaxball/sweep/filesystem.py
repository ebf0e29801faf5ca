"""Files of a store, and leftovers of killed processes beside them."""

import contextlib
import os
import re
import shutil
import time
from pathlib import Path

from ..interface.output import atomic_write, machine

SECONDS_OF_A_PART = 24 * 3600.0
_PART = re.compile(r"\.part-(?P<machine>.+)-(?P<process>\d+)-[^-]+")


def write_whole(path: Path, content: bytes) -> None:
    """Writes a file atomically. Its folder is created if it does not exist."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path, flush=True) as beside:
        beside.write_bytes(content)


def remove_parts(folder: Path) -> None:
    """Removes what killed processes left."""
    for path in folder.rglob(".part-*"):
        path.unlink(missing_ok=True)


def remove_dead_parts(folder: Path) -> None:
    """Removes what killed processes left in ``folder`` itself, where others may be running.

    Whether a process of this machine is dead is known. For other machines it is not, and their files are removed when
    older than a day. Files that cannot be removed stay.
    """
    with contextlib.suppress(OSError):
        for path in folder.glob(".part-*"):
            if _is_dead(path):
                _remove(path)


def _is_dead(path: Path) -> bool:
    named = _PART.fullmatch(path.name)
    if named is None:
        return False
    if named["machine"] == machine() and not _is_running(int(named["process"])):
        return True
    with contextlib.suppress(OSError):
        return time.time() - path.stat().st_mtime > SECONDS_OF_A_PART
    return False


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
