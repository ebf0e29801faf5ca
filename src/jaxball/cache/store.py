"""The folder as a store of programs, which loads those of a command early."""

import concurrent.futures
import contextlib
import functools
import hashlib
import os
from collections.abc import Iterator, Sequence
from typing import Any

from .current import LIST
from .folder import Folder


class FolderStore:
    """A :class:`~.current.Store` of files.

    - ``folder``: where they are.
    - ``arguments``: those of a command, which identify the list of its programs.
    """

    def __init__(self, folder: Folder, arguments: Sequence[str] = ()):
        self.folder, self._arguments = folder, tuple(arguments)
        self._used: dict[str, None] = {}
        self._early: dict[str, concurrent.futures.Future] = {}
        self._expected: list[str] | None = None
        # One thread, because the main one is busy; loading releases Python's lock.
        self._thread = concurrent.futures.ThreadPoolExecutor(1)

    @functools.cached_property
    def _sources(self) -> str:
        from . import surroundings

        return surroundings.sources()

    def identity(self) -> str:
        """The same as long as the store is in use."""
        from . import surroundings

        return surroundings.identity(self._sources)

    def read(self, key: str) -> bytes | None:
        """The content that was written, if it is intact."""
        content = self.folder.read(key)
        if content is not None:
            self._used[key] = None
        return content

    def write(self, key: str, content: bytes) -> None:
        """Keeps the content, unless jaxball's files have changed since they were checked."""
        from . import surroundings

        if surroundings.sources() == self._sources:
            self.folder.write(key, content)
            self._used[key] = None

    @contextlib.contextmanager
    def alone(self, key: str) -> Iterator[bytes | None]:
        """A block in which no other process compiles this program; yields what another has written meanwhile.

        Content that exists but cannot be loaded is compiled by each process.
        """
        if self.folder.read(key) is not None:
            yield None
            return
        with self.folder.alone(key):
            yield self.read(key)

    def early(self, key: str) -> Any:
        """The program, if :meth:`begin` has started loading it."""
        future = self._early.pop(key, None)
        loaded = None if future is None else future.result()
        if loaded is not None:
            self._used[key] = None
        return loaded

    def begin(self) -> None:
        """Starts loading what the command with these arguments last used."""
        from . import executables

        names = self.folder.read(self._list())
        self._expected = [] if names is None else names[len(LIST) :].decode().split()
        for key in self._expected:
            self._early[key] = self._thread.submit(lambda key=key: executables.loaded(self.folder.read(key)))

    def end(self) -> None:
        """Remembers what the command used."""
        self._thread.shutdown(cancel_futures=True)
        if self._expected is not None and self._expected != list(self._used):
            self.folder.write(self._list(), LIST + "\n".join(self._used).encode())

    def _list(self) -> str:
        # Names of files, too, which need not be text.
        named = b"\0".join(map(os.fsencode, ("a command", self.identity(), *self._arguments)))
        return hashlib.blake2b(named, digest_size=20).hexdigest()
