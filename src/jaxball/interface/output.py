"""Atomic writes, and checks of the paths that files are to be written to; a view never overwrites any other file."""

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from . import interruption
from .wording import UserError, one_of


class OutputError(UserError):
    """A file cannot be written; the message is one sentence that names it."""


@contextlib.contextmanager
def atomic_write(path: Path, *, flush: bool = False) -> Iterator[Path]:
    """Yields a temporary path beside ``path``: what is written there replaces ``path`` at the end, unless an error is
    raised.

    A symbolic link is followed: its target is written, and it stays a link. If the process is killed meanwhile,
    ``path`` stays as it was, and a file whose name begins with ``.part-`` is left. With ``flush``, the content is on
    the storage device before it replaces ``path``.

    **Raises:** ``OSError`` when the file cannot be written.
    """
    target = _follow_links(path)
    temporary = target.with_name(f"{part_prefix()}{os.urandom(4).hex()}{target.suffix}")
    with interruption.on_interrupt(lambda: temporary.unlink(missing_ok=True)):
        try:
            yield temporary
            if flush:
                flush_to_disk(temporary)
            temporary.replace(target)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yields a temporary path for a file that is written atomically, with errors as sentences.

    **Raises:** :class:`OutputError` when the file cannot be written; ``path`` is then as it was.
    """
    temporary = None
    try:
        with atomic_write(path) as temporary:
            yield temporary
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        if temporary is not None:
            reason = reason.replace(str(temporary), str(path))
        raise OutputError(f'The file "{path}" cannot be written: {reason}.') from error


def write_text(path: Path, text: str) -> Path:
    """Writes a file atomically, in UTF-8; its path.

    **Raises:** :class:`OutputError` when the file cannot be written; ``path`` is then as it was.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="surrogateescape")  # a file name may not be valid text
    return path


def check_destination(path: Path, suffixes: Sequence[str], argument: str = "path") -> None:
    """Raises an :class:`OutputError` unless a file with one of the ``suffixes`` can be written at ``path``.

    The message calls the path ``argument``.
    """
    if path.suffix not in suffixes:
        raise OutputError(f'Argument `{argument}` must end in {one_of(suffixes)}, but it is "{path}".')
    try:
        folder = _follow_links(path).parent
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
    """Raises an :class:`OutputError` unless files can be written into the folder ``path``, which need not exist yet.

    The message calls the path ``argument``.
    """
    existing = path
    while not existing.exists():
        if existing.is_symlink():
            raise OutputError(
                f'Argument `{argument}` must be a folder, but "{existing}" is a symbolic link that leads to none.'
            )
        existing = existing.parent
    if not existing.is_dir():
        what = f'"{path}" is a file' if existing == path else f'"{path}" would lie in "{existing}", which is a file'
        raise OutputError(f"Argument `{argument}` must be a folder, but {what}.")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise OutputError(f'Argument `{argument}` must be a folder that can be written, but "{existing}" cannot.')


def part_prefix() -> str:
    """Returns the prefix of the names of this process's unfinished files and folders, which identifies their owner."""
    return f".part-{machine()}-{os.getpid()}-"


def machine() -> str:
    """Names the scope in which a process number is unique: the machine and, on Linux, the process namespace."""
    import socket  # here, because most commands need neither it nor the time that it takes

    namespace = Path("/proc/self/ns/pid")
    return f"{socket.gethostname()}-{namespace.stat().st_ino if namespace.exists() else 0}"


def flush_to_disk(path: Path) -> None:
    """Waits until the content of a file, or the entries of a folder, are on the storage device."""
    on_windows = os.name == "nt"  # where folders cannot be opened, and a file must be open for writing
    if on_windows and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDWR if on_windows else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _follow_links(path: Path) -> Path:
    """Follows the symbolic links of a path to where they lead, whether or not anything is there.

    **Raises:** ``OSError`` where they lead in a circle.
    """
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):
        path.stat()
    return Path(os.path.realpath(path))


SUFFIXES = (".html",)
MOST_BODIES = 24  # in a view
MARK = "<!doctype html>\n<!-- jaxball view -->\n"  # what every view begins with


def check_view(path: Path, argument: str = "path") -> None:
    """Raises an :class:`~jaxball.files.results.OutputError` unless a view can be written at ``path``.

    A file that is already there must be a view. The message calls the path ``argument``.
    """
    check_destination(path, SUFFIXES, argument)
    if not path.exists():
        return
    with path.open("rb") as file:
        if file.read(len(MARK.encode())) != MARK.encode():
            raise OutputError(
                f'Argument `{argument}` must be a new file or a view to replace, but "{path}" is another file; remove '
                "it first, or write elsewhere."
            )
