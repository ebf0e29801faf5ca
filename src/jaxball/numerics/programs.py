"""Compiled functions, like those of ``jax.jit`` and ``equinox.filter_jit``, and a store for them.

If the native compiler is chosen (:mod:`jaxball.native`), XLA compiles only programs that it does not support and,
unless it was chosen by name, programs whose loops are over large arrays, as for many runs side by side. Each is traced
once.

If there is a store, a program that was compiled in another process is found by a digest of everything that determines
what it computes, without being traced, and is loaded in a fraction of the time. It is the same machine code, so its
results are the same to the last bit. The store also notes that a program is not compiled natively. Within a trace, and
on devices other than a single CPU, the functions are JAX's and equinox's.
"""

import contextlib
import functools
import weakref
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, ParamSpec, TypeAlias, TypeVar

import equinox as eqx
import jax
import numpy as np

from .. import native
from ..cache import current, executables
from ..cache.current import Store
from ..cache.executables import NoNameError
from ..compat import settings
from ..interface.compilation import compiling
from .fingerprints import Fingerprint, fingerprint

P = ParamSpec("P")
T = TypeVar("T")
_Runs: TypeAlias = Callable[[list[Any]], Any]
QUICKLY = "jax_disable_most_optimizations"
_MISSING: Any = object()
_made: "weakref.WeakSet[Program]" = weakref.WeakSet()


def forget() -> None:
    """Drops the programs of all functions, which are then compiled or loaded again."""
    for program in list(_made):
        program.forget()


def jit(function: Callable[P, T]) -> "Program":
    """Like ``jax.jit``: all leaves of all arguments are arrays. What ``function`` holds distinguishes programs."""
    return Program(function, jax.jit(function), None)


def filter_jit(function: Callable[P, T]) -> Callable[P, T]:
    """Like ``equinox.filter_jit``: the arrays of all arguments are traced, and all else distinguishes programs."""
    return Program(function, eqx.filter_jit(function), eqx.is_array)


@contextlib.contextmanager
def compiled_quickly(wanted: bool = True) -> Iterator[None]:
    """Programs that are first compiled in this block are compiled in less time, but run longer.

    For programs that run once. Native ones, but for ensembles, compile in four fifths of the time and run up to twice
    as long, with the same results; where an optimised one is known, it is used. Those of XLA compile in half the time,
    run several times as long, and their results differ by rounding. Threads share the setting, which is JAX's own.
    """
    before = settings()[QUICKLY]
    jax.config.update(QUICKLY, wanted or before)
    try:
        yield
    finally:
        jax.config.update(QUICKLY, before)


class _Rest(NamedTuple):
    """The parts of arguments or of a result that are not arrays.

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
    """A function, and its programs by the kinds of their arguments.

    - ``large``: whether what has loops over large arrays is compiled natively, too.
    """

    follows = "_programs", "_store"  # what does not determine what it computes

    def __init__(
        self,
        function: Callable[..., Any],
        compiled: Callable[..., Any],
        is_dynamic: Callable[[Any], bool] | None,
        large: bool = False,
    ):
        self._function, self._compiled, self._is_dynamic, self._large = function, compiled, is_dynamic, large
        self._programs: dict[Any, _Runs | None] = {}
        self._store: Store | None = None
        wrapped = function.func if isinstance(function, functools.partial) else function
        functools.update_wrapper(self, wrapped, updated=())  # whose attributes may be those of another of this class
        _made.add(self)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        leaves, structure = jax.tree.flatten((args, kwargs))
        if native.some_traced(leaves):
            return self._compiled(*args, **kwargs)
        rest, arrays = self._parted(leaves, structure)
        program = self._program_for(rest, arrays)
        if program is not None:
            with contextlib.suppress(native.CallbackReachedError):
                return program(arrays)
        return self._compiled(*args, **kwargs)

    def forget(self) -> None:
        """Drops all programs of this function."""
        self._programs.clear()

    def natively(self, *args: Any) -> Callable[[], Any] | None:
        """The call with these arguments, by a natively compiled program; None if that is not possible.

        It may raise ``native.CallbackReachedError``.
        """
        leaves, structure = jax.tree.flatten((args, {}))
        if native.chosen() != "native" or native.some_traced(leaves):
            return None
        rest, arrays = self._parted(leaves, structure)
        program = self._program_for(rest, arrays, only_natively=True)
        return None if program is None else functools.partial(program, arrays)

    def _parted(self, leaves: list[Any], structure: Any) -> tuple[_Rest, list[Any]]:
        if self._is_dynamic is None or not leaves:
            return _Rest(structure), leaves
        dynamic = tuple(map(self._is_dynamic, leaves))
        static = tuple(None if new else leaf for leaf, new in zip(leaves, dynamic, strict=True))
        return _Rest(structure, static, dynamic), [leaf for leaf, new in zip(leaves, dynamic, strict=True) if new]

    def _program_for(self, rest: _Rest, arrays: list[Any], only_natively: bool = False) -> _Runs | None:
        """The program for such arguments; None if JAX compiles it as usual, or if it is not native but must be."""
        if current.store is not self._store:
            self._programs, self._store = {}, current.store
        kinds = tuple(map(native.kind, arrays))
        key = (native.asked_for(), only_natively, rest, tuple(map(type, rest.static)), kinds, native.settings())
        try:
            found = self._programs.get(key, _MISSING)
        except TypeError:  # something has no hash
            return None
        if found is not _MISSING:
            return found
        quickly = settings()[QUICKLY]
        if quickly:
            key = key, QUICKLY
            found = self._programs.get(key, _MISSING)
        if found is _MISSING:
            found = self._programs.setdefault(key, self._found(rest, arrays, only_natively, quickly))
        return found

    def _found(self, rest: _Rest, arrays: list[Any], only_natively: bool, quickly: bool) -> _Runs | None:
        """The program, from the store or compiled: natively, or by XLA if that is chosen or necessary."""
        natively = native.chosen() == "native" and native.usable(arrays)
        store = self._store if native.on_one_cpu() else None
        if store is None and not natively:
            return None
        lowered = functools.cache(lambda: self._lowered(rest, arrays, natively))  # traced once, for both compilers
        if natively:
            large = self._large or only_natively or native.asked_for() == "native"
            quickly &= not large  # Vectors would take several times the stack, in threads that have little.
            kept = self._kept(store, rest, arrays, "native", large, *native.identity())
            known = None
            if kept is not None and quickly:
                known, kept = kept.found(), kept.of_quick_code()
            found = known or _obtained(
                kept, len(arrays), lambda: lowered()[0].natively(large, quickly), lambda: lowered()[1]
            )
            if not isinstance(found, native.Refusal):
                return found
            native.warn_if_asked_for(found, self._name())
        if only_natively:
            return None
        kept = None if _kept_by_jax() else self._kept(store, rest, arrays, "xla", settings()[QUICKLY])
        if kept is None and not natively:
            return None
        found = _obtained(kept, len(arrays), lambda: lowered()[0].by_xla(), lambda: lowered()[1])
        return None if isinstance(found, native.Refusal) else found

    def _name(self) -> str:
        return getattr(self, "__name__", "program")

    def _kept(self, store: Store | None, rest: _Rest, arrays: list[Any], *of_compiler: Any) -> "_Kept | None":
        """The place of the program in the store; None if it has none."""
        if store is None:
            return None

        def identified() -> Fingerprint | None:
            with contextlib.suppress(NoNameError):
                described = self._function, self._is_dynamic is None, rest, *_describe(arrays)
                return fingerprint(store.identity(), *described, *of_compiler)
            return None

        found = identified()
        return found and _Kept(store, found, identified, key=found.digest)

    def _lowered(self, rest: _Rest, arrays: list[Any], natively: bool) -> tuple[native.Lowered, _Rest]:
        """The function, traced for such arrays, and the parts of its result that are not arrays."""
        results: list[_Rest] = []

        def of_arrays(arrays: list[Any]) -> list[Any]:
            args, kwargs = rest.joined(arrays)
            result, arrays = self._parted(*jax.tree.flatten(self._function(*args, **kwargs)))
            results.append(result)
            return arrays

        lowered = native.Lowered(of_arrays, arrays, self._name(), natively)
        return lowered, results[-1]


class _Kept(NamedTuple):
    """The place of a program in a store.

    - ``fingerprint``: of everything that determines the program; ``identified`` finds it again.
    - ``key``: its name there.
    """

    store: Store
    fingerprint: Fingerprint
    identified: Callable[[], Fingerprint | None]
    key: str

    def of_quick_code(self) -> "_Kept":
        """The place of the same program, compiled quickly."""
        return self._replace(key=fingerprint(self.fingerprint.digest, QUICKLY).digest)

    def found(self) -> _Runs | native.Refusal | None:
        """The program; None if there is none."""
        return _as_kept(self.store.early(self.key), self.fingerprint.reached) or self.loaded(self.store.read(self.key))

    def loaded(self, content: bytes | None) -> _Runs | native.Refusal | None:
        """The program of this content; None if there is none."""
        return _as_kept(executables.loaded(content), self.fingerprint.reached)

    def is_pure(self) -> bool:
        """Whether users' functions in it use nothing of jaxball that reads files and the like.

        This holds for all programs in the store, because it depends on nothing but their names there.
        """
        try:
            self.fingerprint.require_pure()
        except NoNameError:
            return False
        return True

    def written(self, content: bytes) -> None:
        """Keeps the content, unless tracing has changed something that the function uses, as what counts calls."""
        again = self.identified()
        if again is not None and again.digest == self.fingerprint.digest:
            self.store.write(self.key, content)


def _obtained(
    kept: _Kept | None, takes: int, make: Callable[[], Any], result: Callable[[], _Rest]
) -> _Runs | native.Refusal:
    """A program for so many arrays: loaded from the store, or compiled and written there."""
    found = kept and kept.found()
    if found is not None:
        return found
    if kept is None or not kept.is_pure():
        with compiling():
            return _as_made(make(), result)
    store, key = kept.store, kept.key
    with store.alone(key) as written:
        found = kept.loaded(written)
        if found is None:
            with compiling():
                made = make()
            kept.written(_content(made, takes, result, kept.fingerprint.reached))
            found = _as_made(made, result)
    return found


def _as_made(made: Any, result: Callable[[], _Rest]) -> _Runs | native.Refusal:
    return made if isinstance(made, native.Refusal) else functools.partial(_run, made, result())


def _content(made: Any, takes: int, result: Callable[[], _Rest], reached: Sequence[Any]) -> bytes:
    """A program as bytes: empty if it cannot be kept, so that no process waits for another to compile it."""
    if isinstance(made, native.Refusal):
        return executables.content_of_refusal(made)
    rest = result()
    gives = sum(rest.dynamic) if rest.dynamic else rest.structure.num_leaves
    return executables.content(made, takes, gives, tuple(rest), reached) or b""


def _as_kept(
    loaded: executables.Loaded | native.Refusal | None, reached: Sequence[Any]
) -> _Runs | native.Refusal | None:
    """A loaded program; None if there is none."""
    if isinstance(loaded, executables.Loaded):
        with contextlib.suppress(Exception):  # whatever a class of another version raises
            return functools.partial(_run, loaded.executable, _Rest(*loaded.result(reached)))
        return None
    return loaded


def _run(compiled: Any, result: _Rest, arrays: list[Any]) -> Any:
    if not isinstance(compiled, native.Program):
        arrays = list(map(_as_converted, arrays))
    return result.joined(compiled(arrays))


def _as_converted(array: Any) -> Any:
    """NumPy arrays with the types that JAX converts them to: some of its versions pass a program 64 bits for 32."""
    if isinstance(array, np.ndarray | np.generic):
        return array.astype(jax.dtypes.canonicalize_dtype(array.dtype), copy=False)
    return array


def _describe(arrays: Sequence[Any]) -> list[Any]:
    """The properties of the arrays that a program depends on, and JAX's settings, for a key in a store."""
    kinds = []
    for array in arrays:
        weak = getattr(array, "weak_type", type(array) in (bool, int, float, complex))
        dtype = array.dtype if hasattr(array, "dtype") else type(array)
        if not isinstance(dtype, np.dtype | type):  # as of random keys
            raise NoNameError(f"Arrays of {dtype} are not kept.")
        kinds.append((np.shape(array), dtype, weak))
    return [kinds, {name: value for name, value in settings().items() if name not in ("jax_default_device", QUICKLY)}]


def _kept_by_jax() -> bool:
    """Whether JAX keeps XLA's programs itself: programs loaded from there cannot be written again."""
    config: Any = jax.config
    return bool(config.jax_enable_compilation_cache and config.jax_compilation_cache_dir)
