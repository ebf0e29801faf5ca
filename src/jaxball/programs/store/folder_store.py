"""The store that ``jaxball.programs.cache`` switches on: the programs of a folder; those of a command are loaded early.

Its identity has what decides how a program is compiled, besides the program and JAX's settings: jaxball's sources,
versions, flags and the processor.
"""

import concurrent.futures
import contextlib
import functools
import hashlib
import importlib
import importlib.util
import os
import platform
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from .current import LIST
from .folder import Folder

OWN = Path(__file__).parents[2]  # the package jaxball
COMPILERS = ("jax", "jaxlib", "numpy")
# Python packages that may be installed in editable form.
LIBRARIES = ("equinox", "diffrax", "optimistix", "lineax", "jaxtyping")
VARIABLES = ("XLA_", "JAX_", "EQX_", "TF_XLA_")
PROCESSOR = ("model name", "flags", "Features", "CPU implementer", "CPU part")


class FolderStore:
    """A :class:`~.current.Store` of files.

    - ``folder``: where they are.
    - ``arguments``: those of a command, which identify the list of its programs.
    - ``keeps_xla``: whether it keeps programs of XLA.
    """

    def __init__(self, folder: Folder, arguments: Sequence[str] = (), keeps_xla: bool = True):
        self.folder, self._arguments, self.keeps_xla = folder, tuple(arguments), keeps_xla
        self._used: dict[str, None] = {}
        self._early: dict[str, concurrent.futures.Future] = {}
        self._expected: list[str] | None = None
        # One thread, because the main one is busy; loading releases Python's lock.
        self._thread = concurrent.futures.ThreadPoolExecutor(1)

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process, such as a worker of a sweep, has a store of its own of the same folder."""
        return FolderStore, (self.folder, (), self.keeps_xla)

    @functools.cached_property
    def _sources(self) -> str:
        return sources()

    def identity(self) -> str:
        """Returns a digest that stays the same as long as the store is in use."""
        return identity(self._sources)

    def read(self, key: str) -> bytes | None:
        """Returns the content that was written, if it is intact."""
        content = self.folder.read(key)
        if content is not None:
            self._used[key] = None
        return content

    def write(self, key: str, content: bytes) -> None:
        """Keeps the content, unless jaxball's files have changed since they were checked."""
        if sources() == self._sources:
            self.folder.write(key, content)
            self._used[key] = None

    @contextlib.contextmanager
    def alone(self, key: str) -> Iterator[bytes | None]:
        """Keeps other processes from compiling this program within the block; yields what another has written
        meanwhile.

        Content that exists but cannot be loaded is compiled by each process.
        """
        if self.folder.read(key) is not None:
            yield None
            return
        with self.folder.alone(key):
            yield self.read(key)

    def early(self, key: str) -> Any:
        """Returns the program, if :meth:`begin` has started loading it."""
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
            self._early[key] = self._thread.submit(lambda key=key: executables.load_program(self.folder.read(key)))

    def end(self) -> None:
        """Remembers what the command used."""
        self._thread.shutdown(cancel_futures=True)
        if self._expected is not None and self._expected != list(self._used):
            self.folder.write(self._list(), LIST + "\n".join(self._used).encode())

    def _list(self) -> str:
        # Names of files, too, which need not be text.
        named = b"\0".join(map(os.fsencode, ("a command", self.identity(), *self._arguments)))
        return hashlib.blake2b(named, digest_size=20).hexdigest()


@functools.cache
def identity(sources: str) -> str:
    """Returns a digest of everything that determines a compiled program; ``sources`` is the digest of jaxball's own
    files.
    """
    parts = [
        sys.version,
        platform.platform(),
        *(f"{name} {importlib.import_module(name).__version__}" for name in COMPILERS),
        *(f"{variable}={value}" for variable, value in sorted(os.environ.items()) if variable.startswith(VARIABLES)),
        *_processor(),
        sources,
    ]
    for library in LIBRARIES:
        spec = importlib.util.find_spec(library)
        if spec is not None and spec.origin is not None:
            parts.extend(_dates(Path(spec.origin).parent))
    return hashlib.blake2b(os.fsencode("\n".join(parts)), digest_size=20).hexdigest()


def sources() -> str:
    """Returns a digest of jaxball's own files; a different one each time if they cannot be read."""
    digest = hashlib.blake2b(digest_size=20)
    try:
        paths = sorted(OWN.rglob("*.py"))
        for path in paths:
            content = path.read_bytes()
            digest.update(f"{path.relative_to(OWN)} {len(content)}\n".encode())
            digest.update(content)
    except OSError:
        paths = []
    return digest.hexdigest() if paths else os.urandom(20).hex()


def _dates(package: Path) -> Iterator[str]:
    """Lists the size and modification time of each Python file of a package."""
    yield str(package)
    for path in sorted(package.rglob("*.py")):
        with contextlib.suppress(OSError):
            status = path.stat()
            yield f"{path} {status.st_size} {status.st_mtime_ns}"


def _processor() -> list[str]:
    """Returns the model and the instructions of the processor; if they cannot be read, the name of the machine."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return [platform.processor(), platform.node()]
    lines = [line for line in text.split("\n\n")[0].splitlines() if line.startswith(PROCESSOR)]
    return [platform.machine(), *lines] if lines else [platform.machine(), platform.node()]
