"""The folder of compiled programs: where it is; private, limited in size, and silent about failures."""

import contextlib
import hashlib
import os
import re
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

OFF, PLACE = "JAXBALL_NO_CACHE", "JAXBALL_CACHE_DIR"  # of the environment
LARGEST_SIZE = 512 * 10**6
KEPT_OF_LIMIT = 0.9  # so that not every new program evicts an old one
SECONDS_OF_A_WRITE = 3600
SECONDS_OF_A_COMPILATION = 900.0
SECONDS_BETWEEN_POLLS = 0.02
MAGIC = b"jaxball program 2\n"
CHECKSUM = hashlib.blake2b(digest_size=32)
_ENTRY = re.compile(r"[0-9a-f]{40}\.program")
_UNFINISHED = re.compile(r"\.part-.*\.program|[0-9a-f]{40}\.lock")


if os.name == "nt":
    import msvcrt

    def _hold(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # pyright: ignore[reportAttributeAccessIssue]
else:
    import fcntl

    def _hold(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


class Entry(NamedTuple):
    """A file of the folder: its size in bytes, and when it was last used, in seconds."""

    path: Path
    size: int
    used: float


class Folder:
    """Programs by key, each a file: a checksum of key and content, then the content.

    Because machine code is loaded, the folder and each file must belong to this user and be writable by nobody else;
    otherwise they are ignored. The least recently used programs make room for new ones.

    - ``path``: where it is, or will be created when something is written.
    - ``limit``: the size of all files together, in bytes.
    """

    def __init__(self, path: Path, limit: int = LARGEST_SIZE):
        self.path, self.limit = path, limit

    def objection(self) -> str | None:
        """Returns why nothing can be read here, as the end of a sentence that begins with the folder; None if
        it can.
        """
        try:
            status = self.path.stat()
        except FileNotFoundError:
            obstacle = _obstacle(self.path)
            return obstacle and f"does not exist and cannot be created: {obstacle}"
        except OSError as error:
            return f"cannot be used: {error.strerror}"
        if not stat.S_ISDIR(status.st_mode):
            return "is a file"
        if not _is_own(status):
            return "belongs to another user"
        return "can be written by others" if _is_open(status) else None

    def read(self, key: str) -> bytes | None:
        """Returns the verified content written under the key; None if it is missing."""
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
        """Keeps the content, if there is room, and removes what exceeds the limit."""
        if len(content) > self.limit or not self._make():
            return
        # Imported here, because it would delay a command that is refused at once.
        from ...interface.output import atomic_write

        with contextlib.suppress(OSError):
            with atomic_write(self._path(key)) as temporary:
                descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
                with open(descriptor, "wb") as file:
                    file.write(_head(key, content) + content)
            self._make_room()

    @contextlib.contextmanager
    def alone(self, key: str) -> Iterator[None]:
        """Keeps other processes out of the block for this key, as long as none takes longer than a compilation."""
        if not self._make():
            yield
            return
        with _hold_lock(self.path / f"{key}.lock", SECONDS_OF_A_COMPILATION):
            yield

    def entries(self) -> list[Entry]:
        """Returns the programs, the least recently used first."""
        return sorted(self._files(_ENTRY), key=lambda entry: entry.used)

    def count(self, beginning: bytes) -> int:
        """Counts the contents that begin with these bytes."""
        start, count = len(MAGIC) + CHECKSUM.digest_size, 0
        for entry in self.entries():
            with contextlib.suppress(OSError), open(entry.path, "rb") as file:
                file.seek(start)
                count += file.read(len(beginning)) == beginning
        return count

    def clear(self) -> list[Entry]:
        """Removes all programs and partially written files. Returns what was removed.

        **Raises:** ``OSError`` where something cannot be removed.
        """
        removed = self.entries()
        for entry in (*removed, *self._files(_UNFINISHED)):
            entry.path.unlink(missing_ok=True)
        return removed

    def _make(self) -> bool:
        """Creates the folder if it does not exist, and returns whether it can be used."""
        if self.objection() is not None:
            return False
        with contextlib.suppress(OSError):
            self.path.mkdir(mode=0o700, parents=True, exist_ok=True)
            return self.objection() is None
        return False

    def _make_room(self) -> None:
        entries = self.entries()
        size = sum(entry.size for entry in entries)
        if size > self.limit:
            for entry in entries[:-1]:  # never the one just written
                if size <= KEPT_OF_LIMIT * self.limit:
                    break
                entry.path.unlink(missing_ok=True)
                size -= entry.size
        for entry in self._files(_UNFINISHED):
            if entry.used < time.time() - SECONDS_OF_A_WRITE:
                entry.path.unlink(missing_ok=True)

    def _files(self, name: re.Pattern[str]) -> list[Entry]:
        files = []
        with contextlib.suppress(OSError), os.scandir(self.path) as files_here:
            for file in files_here:
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
    """Returns the content of a file; None where it is not a file of this user's own, which nobody else can write."""
    # Checked on the open file, because the path may be replaced meanwhile.
    with open(os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)), "rb") as file:
        status = os.fstat(file.fileno())
        private = stat.S_ISREG(status.st_mode) and _is_own(status) and not _is_open(status)
        return file.read() if private else None


def _is_own(status: os.stat_result) -> bool:
    return not hasattr(os, "geteuid") or status.st_uid == os.geteuid()


def _is_open(status: os.stat_result) -> bool:
    return hasattr(os, "geteuid") and bool(status.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def _obstacle(path: Path) -> str | None:
    """Returns why a folder cannot be created, in the words of the operating system; None if it can."""
    existing = next(place for place in (path, *path.absolute().parents) if os.path.lexists(place))
    tried = existing / f".part-{os.getpid()}-{os.urandom(4).hex()}"
    try:
        tried.mkdir()
        tried.rmdir()
    except OSError as error:
        return os.strerror(error.errno) if error.errno else str(error)
    return None


@contextlib.contextmanager
def _hold_lock(path: Path, patience: float) -> Iterator[None]:
    """Waits until no other process holds the lock file, ``patience`` seconds at most, and holds it in this block.

    The operating system releases it when a process ends in any way. Where files cannot be created or locked, it does
    not wait.
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
                time.sleep(SECONDS_BETWEEN_POLLS)
            except OSError:
                break
        yield
    finally:
        with contextlib.suppress(OSError):  # for instance if another process has it open on Windows
            path.unlink()
        os.close(descriptor)


def users_folder(chosen: str | os.PathLike[str] | None = None) -> Folder:
    """Returns the ``chosen`` folder, that of the environment variable ``JAXBALL_CACHE_DIR``, or one in the user's
    cache folder.
    """
    place = chosen or os.environ.get(PLACE)
    if place:
        return Folder(Path(place).expanduser().absolute(), LARGEST_SIZE)
    import platformdirs

    return Folder(platformdirs.user_cache_path("jaxball", appauthor=False) / "programs", LARGEST_SIZE)


def objection_to(folder: Folder) -> str | None:
    """Returns why no programs are kept there, as a sentence; None if they are."""
    if os.environ.get(OFF, "0") not in ("", "0"):
        return f"The variable {OFF} is set."
    objection = folder.objection()
    return None if objection is None else f'The folder "{folder.path}" {objection}.'
