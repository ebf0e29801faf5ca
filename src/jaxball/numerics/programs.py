"""Compiled functions, as of ``jax.jit`` and ``equinox.filter_jit``, and a store in which they may be kept.

Where there is a store, a program that was compiled in another process is found by a digest of all that decides what it
computes, without being traced, and is loaded in a fraction of the time. It is the same machine code, so that its
results are the same to the last bit. Without a store, and within a trace, the functions are JAX's and equinox's.
"""

import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np

from .. import native
from ..cache import current, executables
from ..cache.current import Store
from ..cache.names import NoNameError
from ..compat import is_traced, settings, trace_context
from .fingerprints import digest

P = ParamSpec("P")
T = TypeVar("T")


def jit(function: Callable[P, T]) -> "Program":
    """As ``jax.jit``: all leaves of all arguments are arrays.

    ``function`` is defined at the top of a module, or a ``functools.partial`` of such a one, by whose arguments
    programs are told apart.
    """
    return Program(function, jax.jit(function), None)


def filter_jit(function: Callable[P, T]) -> Callable[P, T]:
    """As ``equinox.filter_jit``: the arrays of all arguments are traced, and programs are told apart by all else.

    ``function`` as of :func:`jit`.
    """
    return Program(function, eqx.filter_jit(function), eqx.is_array)


@contextlib.contextmanager
def compiled_quickly(wanted: bool = True) -> Iterator[None]:
    """Programs that are first called in this block compile in half the time, and then take several times as long.

    For what runs once. The results differ by rounding. Threads share the setting.
    """
    before = settings()["jax_disable_most_optimizations"]
    jax.config.update("jax_disable_most_optimizations", wanted or before)
    try:
        yield
    finally:
        jax.config.update("jax_disable_most_optimizations", before)


class _Rest(NamedTuple):
    """What arguments or a result have beside arrays.

    - ``structure``: a PyTree's.
    - ``static``: the leaves, with None in the places of arrays; empty where all are arrays.
    - ``dynamic``: which leaves are arrays; empty where all are.
    """

    structure: Any
    static: tuple[Any, ...] = ()
    dynamic: tuple[bool, ...] = ()

    def joined(self, arrays: Sequence[Any]) -> Any:
        """The arguments or the result."""
        if not self.dynamic:
            return self.structure.unflatten(arrays)
        remaining = iter(arrays)
        return self.structure.unflatten(
            [next(remaining) if new else leaf for leaf, new in zip(self.static, self.dynamic, strict=True)]
        )


class Program:
    """A function, and its programs with and without a store."""

    def __init__(
        self, function: Callable[..., Any], compiled: Callable[..., Any], is_dynamic: Callable[[Any], bool] | None
    ):
        self._function, self._compiled, self._is_dynamic = function, compiled, is_dynamic
        self._kept: dict[Any, Callable[[list[Any]], Any] | None] = {}
        self._native: dict[Any, Callable[[list[Any]], Any] | None] = {}
        self._store: Store | None = None
        functools.update_wrapper(self, function.func if isinstance(function, functools.partial) else function)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        store, natively = current.store, native.asked_for() == "native"
        if store is None and not natively:
            return self._compiled(*args, **kwargs)
        leaves, structure = jax.tree.flatten((args, kwargs))
        if any(map(is_traced, leaves)):
            return self._compiled(*args, **kwargs)
        rest, arrays = self._parted(leaves, structure)
        program = self._native_for(rest, arrays) if natively else None
        if program is None and store is not None:
            program = self._kept_for(store, rest, arrays)
        return self._compiled(*args, **kwargs) if program is None else program(arrays)

    def natively(self, *args: Any, **kwargs: Any) -> Callable[[], Any] | None:
        """The call with these arguments, by a program that is compiled natively; None where that cannot be."""
        leaves, structure = jax.tree.flatten((args, kwargs))
        if native.asked_for() == "xla" or any(map(is_traced, leaves)):
            return None
        rest, arrays = self._parted(leaves, structure)
        program = self._native_for(rest, arrays)
        return None if program is None else functools.partial(program, arrays)

    def _native_for(self, rest: _Rest, arrays: list[Any]) -> Callable[[list[Any]], Any] | None:
        """The program for such arguments, compiled natively; None where that is not known how."""
        if not native.allowed():
            return None
        key = (rest, tuple(map(type, rest.static)), tuple(map(native.kind, arrays)), native.settings())
        try:
            if key in self._native:
                return self._native[key]
        except TypeError:  # something has no hash
            return None
        if not native.usable(arrays):
            return None
        of_arrays, results = self._of_arrays(rest)
        compiled = native.compiled(of_arrays, arrays, of_arrays.__name__)
        program = None if compiled is None else functools.partial(_run, compiled, results[-1])
        return self._native.setdefault(key, program)

    def _parted(self, leaves: list[Any], structure: Any) -> tuple[_Rest, list[Any]]:
        if self._is_dynamic is None or not leaves:
            return _Rest(structure), leaves
        dynamic = tuple(map(self._is_dynamic, leaves))
        static = tuple(None if new else leaf for leaf, new in zip(leaves, dynamic, strict=True))
        return _Rest(structure, static, dynamic), [leaf for leaf, new in zip(leaves, dynamic, strict=True) if new]

    def _kept_for(self, store: Store, rest: _Rest, arrays: list[Any]) -> Callable[[list[Any]], Any] | None:
        """The program for such arguments; None where it is to be compiled as ever."""
        if store is not self._store:
            self._kept, self._store = {}, store
        key = (rest, tuple(map(type, rest.static)), tuple(map(_kind, arrays)), _settings())
        try:
            if key in self._kept:
                return self._kept[key]
        except TypeError:  # something has no hash
            return None
        program = self._found(store, rest, arrays)
        return self._kept.setdefault(key, program)

    def _found(self, store: Store, rest: _Rest, arrays: list[Any]) -> Callable[[list[Any]], Any] | None:
        """The program, loaded from the store, or compiled and written there."""
        if not _usable():
            return None
        try:
            key = digest(store.identity(), self._function, self._is_dynamic is None, rest, *_describe(arrays))
        except NoNameError:
            return None
        program = _as_kept(store.early(key)) or _as_kept(executables.loaded(store.read(key)))
        if program is not None:
            return program
        with store.alone(key) as written:
            return _as_kept(executables.loaded(written)) or self._compiled_for(store, key, rest, arrays)

    def _compiled_for(self, store: Store, key: str, rest: _Rest, arrays: list[Any]) -> Callable[[list[Any]], Any]:
        """The program, compiled and written to the store."""
        compiled, result = self._made(rest, arrays)
        gives = sum(result.dynamic) if result.dynamic else result.structure.num_leaves
        # Nothing, where it cannot be kept, so that no process waits for another one that compiles it.
        store.write(key, executables.content(compiled, len(arrays), gives, tuple(result)) or b"")
        return functools.partial(_run, compiled, result)

    def _made(self, rest: _Rest, arrays: list[Any]) -> tuple[Any, _Rest]:
        of_arrays, results = self._of_arrays(rest)
        compiled = jax.jit(of_arrays).lower(arrays).compile()
        return compiled, results[-1]

    def _of_arrays(self, rest: _Rest) -> tuple[Callable[[list[Any]], list[Any]], list[_Rest]]:
        """The function of arrays alone, and the list to which tracing it adds what its result has beside them."""
        results: list[_Rest] = []

        def of_arrays(arrays: list[Any]) -> list[Any]:
            args, kwargs = rest.joined(arrays)
            result, arrays = self._parted(*jax.tree.flatten(self._function(*args, **kwargs)))
            results.append(result)
            return arrays

        of_arrays.__name__ = of_arrays.__qualname__ = getattr(self, "__name__", "program")
        return of_arrays, results


def _as_kept(loaded: executables.Loaded | None) -> Callable[[list[Any]], Any] | None:
    """A program that was loaded; None where there is none."""
    if loaded is not None:
        with contextlib.suppress(Exception):  # whatever a class of another version raises
            return functools.partial(_run, loaded.executable, _Rest(*loaded.result()))
    return None


def _run(compiled: Any, result: _Rest, arrays: list[Any]) -> Any:
    return result.joined(compiled(arrays))


def _kind(array: Any) -> Any:
    """What a program knows of an array, for a key within this process."""
    if type(array) is np.ndarray:
        return array.shape, array.dtype
    return jax.typeof(array) if isinstance(array, jax.Array) else (type(array), np.shape(array))


def _describe(arrays: Sequence[Any]) -> list[Any]:
    """What a program knows of the arrays, and JAX's settings, for a key in a store."""
    kinds = []
    for array in arrays:
        weak = getattr(array, "weak_type", type(array) in (bool, int, float, complex))
        dtype = array.dtype if hasattr(array, "dtype") else type(array)
        if not isinstance(dtype, np.dtype | type):  # as of random keys
            raise NoNameError(f"Arrays of {dtype} are not kept.")
        kinds.append((np.shape(array), dtype, weak))
    return [kinds, {name: value for name, value in settings().items() if name != "jax_default_device"}]


def _settings() -> Any:
    """JAX's settings, for a key within this process."""
    config: Any = jax.config
    debugging = config.jax_debug_nans, config.jax_debug_infs, config.jax_disable_jit
    return trace_context(), config.jax_default_device, debugging


def _usable() -> bool:
    """Whether programs can be kept: those for the one device of a CPU, without settings that are for debugging.

    Where JAX keeps programs itself, it is left to it: what was loaded from there cannot be written once more.
    """
    config: Any = jax.config
    if config.jax_enable_compilation_cache and config.jax_compilation_cache_dir:
        return False
    debugging = config.jax_debug_nans or config.jax_debug_infs or config.jax_disable_jit
    if debugging or not jax.sharding.get_abstract_mesh().empty or jax.default_backend() != "cpu":
        return False
    return jax.device_count() == 1 and config.jax_default_device in (None, "cpu", jax.devices()[0])
