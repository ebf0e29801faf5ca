"""Where compiled programs are kept now, if anywhere."""

import contextlib
from collections.abc import Iterator
from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Store(Protocol):
    """Keeps contents by keys. What cannot be read or written is not there, and no reason for an error."""

    def identity(self) -> str:
        """A digest of what decides how programs are compiled, but for JAX's settings: versions, flags, processor."""
        ...

    def read(self, key: str) -> bytes | None:
        """What was written, whole."""
        ...

    def write(self, key: str, content: bytes) -> None:
        """Keeps the content for later, if it can."""
        ...

    def alone(self, key: str) -> contextlib.AbstractContextManager[bytes | None]:
        """No other process compiles the program of this key in this block; what one has written of it meanwhile."""
        ...

    def early(self, key: str) -> Any:
        """As of :func:`~.executables.loaded`, where that was begun before it was asked for; else None."""
        ...


store: Store | None = None


def keep_in(new: Store | None) -> Store | None:
    """Keeps programs in a store from now on, or in none. Returns the one before."""
    global store
    before, store = store, new
    return before


@contextlib.contextmanager
def kept_in(new: Store | None) -> Iterator[None]:
    """Keeps the programs of this block in a store, or in none."""
    before = keep_in(new)
    try:
        yield
    finally:
        keep_in(before)
