"""The folder of compiled programs: private, limited in size, and never an error or a message."""

import contextlib
import hashlib
import os
import re
import stat
import time
from pathlib import Path
from typing import NamedTuple

LIMIT = 512 * 10**6
KEPT_OF_LIMIT = 0.9  # so that what is new does not push something out each time
SECONDS_OF_A_WRITE = 3600
MAGIC = b"jaxball program 1\n"
CHECKSUM = hashlib.blake2b(digest_size=32)
_ENTRY = re.compile(r"[0-9a-f]{40}\.program")
_UNFINISHED = re.compile(r"\.part-.*\.program")


class Entry(NamedTuple):
    """A file of the folder: its size in bytes, and when it was used last, in seconds."""

    path: Path
    size: int
    used: float


class Folder:
    """Programs by key, each a file: a checksum of key and content, then the content.

    What is loaded is machine code. So the folder, and each file, must belong to this user and be writable by nobody
    else; what is not is as good as not there. The programs that were used longest ago make room for new ones.

    - ``path``: where it is, or will be made when something is written.
    - ``limit``: the size of all files together, in bytes.
    """

    def __init__(self, path: Path, limit: int = LIMIT):
        self.path, self.limit = path, limit

    def objection(self) -> str | None:
        """Why nothing can be read here, as the end of a sentence that begins with the folder; None where it can."""
        try:
            status = self.path.stat()
        except FileNotFoundError:
            return None if _can_be_made(self.path) else "does not exist and cannot be made"
        except OSError as error:
            return f"cannot be used: {error.strerror}"
        if not stat.S_ISDIR(status.st_mode):
            return "is a file"
        if not _is_own(status):
            return "belongs to another user"
        return "can be written by others" if _is_open(status) else None

    def can_be_written(self) -> bool:
        """Whether programs can be added."""
        return os.access(self.path, os.W_OK | os.X_OK) if self.path.exists() else _can_be_made(self.path)

    def read(self, key: str) -> bytes | None:
        """What was written under the key, whole and as it was; None if it is not there."""
        path = self._path(key)
        if self.objection() is not None:
            return None
        try:
            content = _private_content(path)
            if content is None:
                return None
            start = len(MAGIC) + CHECKSUM.digest_size
            if content[:start] != _head(key, content[start:]):
                path.unlink()
                return None
            with contextlib.suppress(OSError):
                os.utime(path)
            return content[start:]
        except OSError:
            return None

    def write(self, key: str, content: bytes) -> None:
        """Keeps the content, if there is room, and removes what is too much."""
        if len(content) > self.limit or self.objection() is not None:
            return
        # Imported here, because a command that is refused at once has no time for it.
        from ..interface.output import atomic_write

        with contextlib.suppress(OSError):
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            if self.objection() is not None:
                return
            with atomic_write(self._path(key)) as temporary:
                descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
                with open(descriptor, "wb") as file:
                    file.write(_head(key, content) + content)
            self._make_room()

    def entries(self) -> list[Entry]:
        """The programs, those used longest ago first."""
        return sorted(self._files(_ENTRY), key=lambda entry: entry.used)

    def clear(self) -> list[Entry]:
        """Removes all programs, and what was left half written. Returns what was removed.

        **Raises:** ``OSError`` where something cannot be removed.
        """
        removed = self.entries()
        for entry in (*removed, *self._files(_UNFINISHED)):
            entry.path.unlink(missing_ok=True)
        return removed

    def _make_room(self) -> None:
        entries = self.entries()
        size = sum(entry.size for entry in entries)
        if size > self.limit:
            for entry in entries[:-1]:  # never what was just written
                if size <= KEPT_OF_LIMIT * self.limit:
                    break
                entry.path.unlink(missing_ok=True)
                size -= entry.size
        for entry in self._files(_UNFINISHED):
            if entry.used < time.time() - SECONDS_OF_A_WRITE:
                entry.path.unlink(missing_ok=True)

    def _files(self, name: re.Pattern[str]) -> list[Entry]:
        files = []
        with contextlib.suppress(OSError), os.scandir(self.path) as found:
            for file in found:
                with contextlib.suppress(OSError):  # another process removed it
                    status = file.stat(follow_symlinks=False)
                    if name.fullmatch(file.name) and stat.S_ISREG(status.st_mode):
                        files.append(Entry(Path(file.path), status.st_size, status.st_mtime))
        return files

    def _path(self, key: str) -> Path:
        return self.path / f"{key}.program"


def _head(key: str, content: bytes) -> bytes:
    checksum = CHECKSUM.copy()
    checksum.update(key.encode())
    checksum.update(content)
    return MAGIC + checksum.digest()


def _private_content(path: Path) -> bytes | None:
    """The content of a file; None where it is not a file of this user's own, which nobody else can write."""
    # Asked of the open file, because another may take the place of what has the path.
    with open(os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)), "rb") as file:
        status = os.fstat(file.fileno())
        private = stat.S_ISREG(status.st_mode) and _is_own(status) and not _is_open(status)
        return file.read() if private else None


def _is_own(status: os.stat_result) -> bool:
    return not hasattr(os, "geteuid") or status.st_uid == os.geteuid()


def _is_open(status: os.stat_result) -> bool:
    return hasattr(os, "geteuid") and bool(status.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def _can_be_made(path: Path) -> bool:
    existing = next((parent for parent in path.absolute().parents if parent.exists()), None)
    return existing is not None and existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)
