"""Compiled programs kept between processes, so that each is compiled once on a machine.

Native programs are kept by default, in the user's cache folder, from the first that is compiled; the command line keeps
those of XLA as well. ``disable()``, or ``JAXBALL_NO_CACHE=1`` in the environment, switches that off, and
``JAXBALL_CACHE_DIR`` names another folder.

Kept are jaxball's own programs, also for rails, laws and the like that are yours, and those of functions that
:func:`jaxball.jit` compiles. A program is identified by jaxball's files, the versions of its dependencies, its
compiler, XLA's flags, JAX's settings, the processor, the kinds of its arguments, and what your functions and classes in
it consist of; what cannot be identified is compiled in each process (:func:`jaxball.jit`). It is the same machine code,
so numbers are the same to the last bit.
"""

import contextlib
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from .store import current
from .store.current import GPU, NATIVE, XLA
from .store.folder import objection_to, users_folder
from .store.folder_store import FolderStore

__all__ = ["clear", "contents", "disable", "enable"]

# XLA checks preferences of the target processor as though they were instructions, and complains on stderr.
LOG_LEVEL, OF_ALL_THAT_JAX_STARTS, SILENT = "TF_CPP_MIN_LOG_LEVEL", "1", "3"


class Contents(NamedTuple):
    """The contents of the cache.

    - ``folder``: where it is.
    - ``files``: the number of files: one for each program, and one for each command with the list of its programs.
    - ``native``, ``xla``: the number of programs by each compiler.
    - ``size``, ``limit``: of all files together, in bytes; at the limit, the least recently used are removed.
    - ``objection``: why it is not used, as a sentence; None if it is.
    """

    folder: Path
    files: int
    native: int
    xla: int
    size: int
    limit: int
    objection: str | None


def enable(folder: str | os.PathLike[str] | None = None) -> bool:
    """Keeps compiled programs in a folder from now on, those of XLA as well, and uses those already kept.

    Call it before JAX is imported if XLA complains about the processor's features when programs are loaded.

    **Arguments:**

    - ``folder``: where; by default the environment variable ``JAXBALL_CACHE_DIR``, or the user's cache folder.

    **Returns:** whether programs are kept: False where the variable ``JAXBALL_NO_CACHE`` is set, or where the folder
    cannot be created, belongs to another user or can be written by others; :func:`contents` has the reason. If JAX
    itself keeps XLA's programs (``JAX_COMPILATION_CACHE_DIR``), those are left to it.
    """
    place = users_folder(folder)
    if objection_to(place) is not None:
        return False
    _silence()
    current.keep_in(FolderStore(place))
    return True


def disable() -> None:
    """Stops keeping and using programs from now on; existing ones remain."""
    current.keep_in(None)


def contents(folder: str | os.PathLike[str] | None = None) -> Contents:
    """Returns the contents of the cache, and whether it is used. Does not need JAX.

    **Arguments:**

    - ``folder``: as for :func:`enable`.
    """
    place = users_folder(folder)
    entries = place.entries()
    size = sum(entry.size for entry in entries)
    of_each = place.count(NATIVE) + place.count(GPU), place.count(XLA)
    return Contents(place.path, len(entries), *of_each, size, place.limit, objection_to(place))


def clear(folder: str | os.PathLike[str] | None = None) -> Contents:
    """Removes all programs, and returns what the contents were. Does not need JAX.

    **Arguments:**

    - ``folder``: as for :func:`enable`.

    **Raises:** ``OSError`` where something cannot be removed.
    """
    before = contents(folder)
    users_folder(folder).clear()
    return before


@contextlib.contextmanager
def of_a_command(arguments: Sequence[str]) -> Iterator[None]:
    """Keeps programs in this block; afterwards everything is as before. ``arguments`` are those of the command."""
    if objection_to(users_folder()) is not None or current.chosen() is not None:
        yield
        return
    _silence()
    store = FolderStore(users_folder(), arguments)
    with current.keep_within(store):
        try:
            yield
        finally:
            store.end()


def load_early() -> None:
    """Starts loading, in a thread, what the same command needed when it last ran. JAX must be imported and set up."""
    store = current.store()
    if isinstance(store, FolderStore):
        store.begin()


def _silence() -> None:
    if "jax" not in sys.modules and os.environ.get(LOG_LEVEL, OF_ALL_THAT_JAX_STARTS) == OF_ALL_THAT_JAX_STARTS:
        os.environ[LOG_LEVEL] = SILENT


def __dir__() -> list[str]:
    return __all__
