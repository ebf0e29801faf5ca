"""Compiled programs with the structure of their results, and where they are kept between processes.

If there is a store, a program that was compiled in another process is found by a digest of everything that determines
what it computes, without being traced, and is loaded in a fraction of the time. It is the same machine code, so its
results are the same to the last bit. The store also notes that a program is not compiled natively.
"""

import contextlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from ..interface.compat import settings
from . import native
from .identity.fingerprints import Fingerprint, fingerprint
from .identity.names import NoNameError
from .store import executables
from .store.current import Store

QUICKLY = "jax_disable_most_optimizations"


class Rest(NamedTuple):
    """The parts of arguments or of a result that are not arrays.

    - ``structure``: a PyTree's.
    - ``static``: the leaves, with None in the places of arrays; empty where all are arrays.
    - ``dynamic``: which leaves are arrays; empty where all are.
    - ``keys``: how each array makes random numbers, if it consists of random keys; empty where none does.
    """

    structure: Any
    static: tuple[Any, ...] = ()
    dynamic: tuple[bool, ...] = ()
    keys: tuple[Any, ...] = ()

    def with_keys(self, arrays: Sequence[Any]) -> Any:
        """Returns the arguments or the result, with random keys made of their numbers."""
        if self.keys:
            arrays = native.as_keys(arrays, self.keys)
        if not self.dynamic:
            return self.structure.unflatten(arrays)
        remaining = iter(arrays)
        return self.structure.unflatten(
            [next(remaining) if new else leaf for leaf, new in zip(self.static, self.dynamic, strict=True)]
        )


class Compiled(NamedTuple):
    """A compiled program, of arrays of numbers, with the parts of its result that are not arrays."""

    executable: Any
    result: Rest

    def run(self, arrays: list[Any]) -> list[Any]:
        """Returns the arrays of the result, as numbers."""
        if not isinstance(self.executable, native.Executable):
            arrays = list(map(_as_converted, arrays))
        return self.executable(arrays)

    @property
    def target(self) -> str | None:
        """The name by which XLA calls it, if it can."""
        can_be_called = isinstance(self.executable, native.Executable | native.GridExecutable)
        return self.executable.target if can_be_called else None

    @property
    def gives(self) -> list[jax.ShapeDtypeStruct]:
        """The types of the arrays of the result of a native program."""
        described = self.executable.form.gives
        return [jax.ShapeDtypeStruct(shape, dtype, weak_type=is_weak) for shape, dtype, is_weak in described]


class Place(NamedTuple):
    """The place of a program in a store.

    - ``fingerprint``: of everything that determines the program; ``identify`` finds it again.
    - ``key``: its name there.
    """

    store: Store
    fingerprint: Fingerprint
    identify: Callable[[], Fingerprint | None]
    key: str

    def of_quick_code(self) -> "Place":
        """Returns the place of the same program, compiled quickly."""
        return self._replace(key=fingerprint(self.fingerprint.digest, QUICKLY).digest)

    def find(self) -> Compiled | native.Refusal | None:
        """Returns the program; None if there is none."""
        return self._as_kept(self.store.early(self.key)) or self._load(self.store.read(self.key))

    def obtain(self, compiled: Callable[[], Compiled | native.Refusal], takes: int) -> Compiled | native.Refusal:
        """Returns the program that takes ``count`` arrays: loaded, or compiled and written."""
        program = self.find()
        if program is not None:
            return program
        if not self._is_pure():
            return compiled()
        with self.store.alone(self.key) as written:
            program = self._load(written)
            if program is None:
                program = compiled()
                self._write(self._content(program, takes))
        return program

    def _load(self, content: bytes | None) -> Compiled | native.Refusal | None:
        """Returns the program of this content; None if there is none."""
        return self._as_kept(executables.load_program(content))

    def _is_pure(self) -> bool:
        """Returns whether users' functions in it use nothing of jaxball that reads files and the like.

        This holds for all programs in the store, because it depends on nothing but their names there.
        """
        try:
            self.fingerprint.require_pure()
        except NoNameError:
            return False
        return True

    def _write(self, content: bytes) -> None:
        """Keeps the content, unless tracing has changed something that the function uses, such as a counter."""
        again = self.identify()
        if again is not None and again.digest == self.fingerprint.digest:
            self.store.write(self.key, content)

    def _content(self, program: Compiled | native.Refusal, takes: int) -> bytes:
        """Converts a program to bytes: empty if it cannot be kept, so that no process waits for another to
        compile it.
        """
        if isinstance(program, native.Refusal):
            return executables.content_of_refusal(program)
        executable, rest = program
        gives = sum(rest.dynamic) if rest.dynamic else rest.structure.num_leaves
        return executables.content(executable, takes, gives, tuple(rest), self.fingerprint.reached) or b""

    def _as_kept(self, loaded: executables.Loaded | native.Refusal | None) -> Compiled | native.Refusal | None:
        """Returns a loaded program; None if there is none."""
        if isinstance(loaded, executables.Loaded):
            with contextlib.suppress(Exception):  # whatever a class of another version raises
                return Compiled(loaded.executable, Rest(*loaded.result(self.fingerprint.reached)))
            return None
        return loaded


def place_in(store: Store | None, *described: Any) -> Place | None:
    """Returns the place in a store of the program that is ``described``, besides JAX's settings; None if it
    has none.
    """
    if store is None:
        return None
    chosen = {name: value for name, value in settings().items() if name not in ("jax_default_device", QUICKLY)}

    def identify() -> Fingerprint | None:
        with contextlib.suppress(NoNameError):
            return fingerprint(store.identity(), *described, chosen)
        return None

    name = identify()
    return name and Place(store, name, identify, key=name.digest)


def is_kept_by_jax() -> bool:
    """Returns whether JAX keeps XLA's programs itself: programs loaded from there cannot be written again."""
    config: Any = jax.config
    return bool(config.jax_enable_compilation_cache and config.jax_compilation_cache_dir)


def _as_converted(array: Any) -> Any:
    """Converts NumPy arrays to the types that JAX converts them to: some of its versions pass a program 64
    bits for 32.
    """
    if isinstance(array, np.ndarray | np.generic):
        return array.astype(jax.dtypes.canonicalize_dtype(array.dtype), copy=False)
    return array
