"""The current store of compiled programs, if any, and the kinds of its contents."""

import contextlib
import functools
from collections.abc import Iterator
from typing import Any, Protocol, runtime_checkable

NATIVE, XLA = b"native\n", b"xla\n"  # a program of one compiler or the other
GPU = b"gpu\n"  # a native program of a GPU
REFUSAL = b"refused\n"  # the note that a program is not compiled natively
LIST = b"list\n"  # the keys of a command's programs


@runtime_checkable
class Store(Protocol):
    """Keeps contents by keys. Contents that cannot be read or written are treated as missing, without an error.

    - ``keeps_xla``: whether it keeps programs of XLA, too, which complains on stderr when it loads one.
    """

    keeps_xla: bool

    def identity(self) -> str:
        """Returns a digest of the versions, flags and processor with which programs are compiled; not of JAX's
        settings.
        """
        ...

    def read(self, key: str) -> bytes | None:
        """Returns the content that was written, if it is intact."""
        ...

    def write(self, key: str, content: bytes) -> None:
        """Keeps the content for later, if it can."""
        ...

    def alone(self, key: str) -> contextlib.AbstractContextManager[bytes | None]:
        """Ensures that no other process compiles this program within a block; yields the content that another has
        written meanwhile.
        """
        ...

    def early(self, key: str) -> Any:
        """Returns the same as :func:`~.executables.load_program`, if loading was started early; otherwise None."""
        ...


_choice: list[Store | None] = []  # the store that was chosen, or none; empty as long as there was no choice


def store() -> Store | None:
    """Returns the store that was chosen, which may be none; without a choice that of the user, for native programs."""
    return _choice[0] if _choice else _of_user()


def chosen() -> Store | None:
    """Returns the store that was chosen, if any was."""
    return _choice[0] if _choice else None


def keep_in(new: Store | None) -> None:
    """Keeps programs in a store from now on, or in none."""
    _choice[:] = [new]


@contextlib.contextmanager
def keep_within(new: Store | None) -> Iterator[None]:
    """Keeps the programs of this block in a store, or in none."""
    before = [*_choice]
    keep_in(new)
    try:
        yield
    finally:
        _choice[:] = before


@functools.cache
def _of_user() -> Store | None:
    from .folder import objection_to, users_folder
    from .folder_store import FolderStore

    folder = users_folder()
    return FolderStore(folder, keeps_xla=False) if objection_to(folder) is None else None
