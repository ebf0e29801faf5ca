"""Files that are written whole or not at all, and places where none can be."""

import contextlib
import os
import secrets
import socket
from collections.abc import Iterator, Sequence
from pathlib import Path

from . import interruption
from .wording import one_of


class OutputError(ValueError):
    """A file cannot be written; the message is one sentence that names it."""


@contextlib.contextmanager
def whole(path: Path, *, flush: bool = False) -> Iterator[Path]:
    """A path to write to, beside ``path``; what is there at the end is moved to ``path``, unless something was raised.

    A symbolic link is followed: what it leads to is written, and it stays a link. A process that is killed on the way
    leaves ``path`` as it was, and a file whose name begins with ``.part-``. With ``flush`` the content is on the disk
    before it is moved.

    **Raises:** ``OSError`` when the file cannot be written.
    """
    target = _followed(path)
    beside = target.with_name(f"{part_prefix()}{secrets.token_hex(4)}{target.suffix}")
    with interruption.before_the_end(lambda: beside.unlink(missing_ok=True)):
        try:
            yield beside
            if flush:
                flush_to_disk(beside)
            beside.replace(target)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to, beside ``path``, as :func:`whole` has it.

    **Raises:** :class:`OutputError` when the file cannot be written; ``path`` is then as it was.
    """
    beside = None
    try:
        with whole(path) as beside:
            yield beside
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        if beside is not None:
            reason = reason.replace(str(beside), str(path))
        raise OutputError(f'The file "{path}" cannot be written: {reason}.') from error


def check_destination(path: Path, suffixes: Sequence[str], argument: str = "path") -> None:
    """Raises an :class:`OutputError` unless a file with one of ``suffixes`` can be written at ``path``.

    The message calls it ``argument``.
    """
    if path.suffix not in suffixes:
        raise OutputError(f'Argument `{argument}` must end in {one_of(suffixes)}, but it is "{path}".')
    try:
        folder = _followed(path).parent
    except OSError as error:
        raise OutputError(
            f'Argument `{argument}` must be a file that can be written, but "{path}" is not: {error.strerror}.'
        ) from None
    if path.is_dir():
        raise OutputError(f'Argument `{argument}` must be a file, but "{path}" is a folder.')
    shown = f'"{path.parent}"' if not path.is_symlink() else f'"{folder}", to which "{path}" leads,'
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"Argument `{argument}` must lie in a folder, but {shown} is a file.")
    if not folder.is_dir():
        raise OutputError(
            f"Argument `{argument}` must lie in a folder that exists, but {shown} does not; make it first."
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"Argument `{argument}` must lie in a folder that can be written, but {shown} cannot.")


def check_folder(path: Path, argument: str = "folder") -> None:
    """Raises an :class:`OutputError` unless files can be written into the folder ``path``, which may have to be made.

    The message calls it ``argument``.
    """
    there = path
    while not there.exists():
        if there.is_symlink():
            raise OutputError(
                f'Argument `{argument}` must be a folder, but "{there}" is a symbolic link that leads to none.'
            )
        there = there.parent
    if not there.is_dir():
        what = f'"{path}" is a file' if there == path else f'"{path}" would lie in "{there}", which is a file'
        raise OutputError(f"Argument `{argument}` must be a folder, but {what}.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise OutputError(f'Argument `{argument}` must be a folder that can be written, but "{there}" cannot.')


def part_prefix() -> str:
    """How the names begin of files and folders that this process has not finished: they say whose they are."""
    return f".part-{machine()}-{os.getpid()}-"


def machine() -> str:
    """Where the number of a process says which it is: the machine and, on Linux, the namespace of the numbers."""
    namespace = Path("/proc/self/ns/pid")
    return f"{socket.gethostname()}-{namespace.stat().st_ino if namespace.exists() else 0}"


def flush_to_disk(path: Path) -> None:
    """Waits until the content of a file, or the names in a folder, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _followed(path: Path) -> Path:
    """Where the symbolic links of a path lead, be there something or not.

    **Raises:** ``OSError`` where they lead in a circle.
    """
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        path.stat()
    return Path(os.path.realpath(path))
