"""Functions of arrays of certain types: traced once, with their compiled programs and the functions that follow.

What follows from a function is its derivative along tangents, the cotangents of its arguments, and the function of many
rows or directions at once. Each of these is such a function again, compiled where it is first needed.

If there is a store, a program that was compiled in another process is found by a digest of everything that determines
what it computes, without being traced, and is loaded in a fraction of the time. It is the same machine code, so its
results are the same to the last bit. The store also notes that a program is not compiled natively.
"""

import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from .. import native
from ..cache import current, executables
from ..cache.current import Store
from ..cache.executables import NoNameError
from ..compat import setting_of_traces, settings
from ..interface.compilation import compiling
from .differentiation import differentiated_forward
from .fingerprints import Fingerprint, fingerprint
from .reverse_rules import chosen, pulled_by_forward_mode, replaced

Runs: TypeAlias = Callable[[list[Any]], Any]
QUICKLY = "jax_disable_most_optimizations"
BLOCK = native.FEWEST * native.LANES  # rows that a program computes at once
TOGETHER = 64  # rows that are one solve by XLA on a CPU, where 512 were no faster

_within = setting_of_traces(False)


def within_a_computation() -> bool:
    """Whether what is being traced is a computation of jaxball's own, of which all is compiled as one program."""
    return _within.value


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

    def joined(self, arrays: Sequence[Any]) -> Any:
        """The arguments or the result, with random keys made of their numbers."""
        if self.keys:
            arrays = native.as_keys(arrays, self.keys)
        if not self.dynamic:
            return self.structure.unflatten(arrays)
        remaining = iter(arrays)
        return self.structure.unflatten(
            [next(remaining) if new else leaf for leaf, new in zip(self.static, self.dynamic, strict=True)]
        )


class Result(NamedTuple):
    """The arrays of a result, and the parts of it that are not."""

    arrays: list[Any]
    rest: Rest


def call_with(
    function: Callable[..., Any], is_dynamic: Callable[[Any], bool] | None, rest: Rest, arrays: list[Any]
) -> Result:
    """The result of a function of PyTrees, of the arrays of its arguments and their ``rest``."""
    args, kwargs = rest.joined(arrays)
    result, arrays = parted(*jax.tree.flatten(function(*args, **kwargs)), is_dynamic)
    return Result([jnp.asarray(native.numbers(array)) for array in arrays], result)


def parted(leaves: list[Any], structure: Any, is_dynamic: Callable[[Any], bool] | None) -> tuple[Rest, list[Any]]:
    """A flattened PyTree as its arrays, which are all leaves if there is no ``is_dynamic``, and the rest."""
    if is_dynamic is None or not leaves:
        return Rest(structure, keys=_keys(leaves)), leaves
    dynamic = tuple(map(is_dynamic, leaves))
    static = tuple(None if new else leaf for leaf, new in zip(leaves, dynamic, strict=True))
    arrays = chosen(leaves, dynamic)
    return Rest(structure, static, dynamic, _keys(arrays)), arrays


def _keys(arrays: list[Any]) -> tuple[Any, ...]:
    keys = tuple(map(native.implementation, arrays))
    return keys if any(keys) else ()


class Computation:
    """A function of a list of arrays, for arrays of certain types.

    **Arguments:**

    - ``function``: of a list of arrays, to another, or to a :class:`Result`.
    - ``arrays``: such arrays, or their types.
    - ``name``: in messages and profiles.
    - ``large``: whether what has loops over large arrays is compiled natively, too.
    - ``in_lanes``: whether rows are computed side by side in the lanes of vectors, or else one after another.
    - ``together``: how many rows XLA computes side by side on a CPU.
    - ``gives``: the types of the results, where they are known.
    - ``opaque``: whether all within is one program; otherwise, as in a user's function, computations in it are
      differentiated and mapped by themselves.
    """

    # What follows from it: how a function made of ``function`` can be differentiated, and which arguments are linear.
    smooth: Callable[[list[Any]], Any]  # the same function, in a form that forward mode differentiates
    linear: tuple[bool, ...]
    is_derivative = False
    rows: native.Rows | None = None
    takes_keys = False

    def __init__(
        self,
        function: Callable[[list[Any]], Any],
        arrays: Sequence[Any],
        *,
        name: str,
        large: bool = False,
        in_lanes: bool = True,
        together: int = TOGETHER,
        opaque: bool = True,
        gives: Sequence[Any] | None = None,
    ):
        self.function = self.smooth = function
        self.name, self.large, self.in_lanes, self.together, self.opaque = name, large, in_lanes, together, opaque
        self._gives = gives
        self._results: list[Rest] = []
        self.linear = (False,) * len(arrays)
        self.traced = native.Lowered(
            self._of_arrays, arrays, name, native.chosen() == "native", lambda: _within(self.opaque)
        )
        self.takes = self.traced.takes
        self._made: dict[Any, Any] = {}

    def _of_arrays(self, arrays: list[Any]) -> list[Any]:
        result = self.function(arrays)
        if not isinstance(result, Result):
            result = Result(result, Rest(jax.tree.structure(result)))
        self._results.append(result.rest)
        return result.arrays

    # What is known without a program

    @property
    def gives(self) -> list[Any]:
        """The types of the arrays of the result."""
        if self._gives is None:
            self._gives = self.traced.gives
        return list(self._gives)

    @property
    def result(self) -> Rest:
        """The parts of the result that are not arrays."""
        if not self._results:
            _ = self.traced.traced
        return self._results[-1]

    def is_pure(self) -> bool:
        """Whether it does nothing but compute, of its arguments alone, numbers that XLA's arrays can hold."""
        program = self.traced.traced.jaxpr
        has_numbers = all(isinstance(one.dtype, np.dtype) and one.dtype != jax.dtypes.float0 for one in self.gives)
        captures = len(program.in_avals) > len(self.takes)  # numbers that are traced around it
        return has_numbers and not program.effects and not captures

    # Programs

    def here(self, arrays: Sequence[Any]) -> list[Any]:
        """The results, written into what is being traced."""
        traced = self.traced if native.traced_natively() else self.traced.for_xla()
        with traced.as_traced():
            return traced.function(list(arrays))

    def __call__(self, arrays: Sequence[Any]) -> list[Any]:
        """The arrays of the result, of arrays that are not traced."""
        runs = self.runs(current.store)
        if runs is not None:
            with contextlib.suppress(native.CallbackReachedError):
                return runs.numbers(list(arrays))
        return self.here(arrays)

    def program(self) -> native.Program | None:
        """The natively compiled program, if there is one."""
        runs = self.runs(current.store, only_natively=True)
        return None if runs is None else runs.made

    def runs(self, store: Store | None, only_natively: bool = False) -> "Compiled | None":
        """The program, from the store or compiled: natively, or by XLA if that is chosen or necessary.

        None if JAX compiles it as usual, or if it is not native but must be.
        """
        key = store, only_natively, native.asked_for(), native.settings(), settings()[QUICKLY]
        if key not in self._made:
            self._made[key] = self._compiled(store, only_natively)
        return self._made[key]

    def _compiled(self, store: Store | None, only_natively: bool) -> "Compiled | None":
        natively = native.chosen() == "native" and native.allowed()
        store = store if native.on_one_cpu() else None
        if store is None and not natively:
            return None
        quickly = settings()[QUICKLY]
        if natively:
            large = self.large or only_natively or native.asked_for() == "native"
            quickly &= not large  # Vectors would take several times the stack, in threads that have little.
            kept = self._kept(store, "native", large, *native.identity())
            known = None
            if kept is not None and quickly:
                known, kept = kept.found(), kept.of_quick_code()
            found = known or self._obtained(kept, lambda: self.traced.natively(large, quickly, self.rows))
            if not isinstance(found, native.Refusal):
                return found
            native.warn_if_asked_for(found, self.name)
        if only_natively:
            return None
        kept = None if _kept_by_jax() else self._kept(store, "xla", settings()[QUICKLY])
        if kept is None and not natively:
            return None
        found = self._obtained(kept, self.traced.by_xla)
        return None if isinstance(found, native.Refusal) else found

    def _kept(self, store: Store | None, *of_compiler: Any) -> "_Kept | None":
        """The place of the program in the store; None if it has none."""
        if store is None:
            return None

        def identified() -> Fingerprint | None:
            with contextlib.suppress(NoNameError):
                described = self.function, self.opaque, self.rows, *_describe(self.takes)
                return fingerprint(store.identity(), *described, *of_compiler)
            return None

        found = identified()
        return found and _Kept(store, found, identified, key=found.digest)

    def _obtained(self, kept: "_Kept | None", make: Callable[[], Any]) -> "Compiled | native.Refusal":
        """The program: loaded from the store, or compiled and written there."""
        found = kept and kept.found()
        if found is not None:
            return found
        if kept is None or not kept.is_pure():
            with compiling():
                return _as_made(make(), self)
        store, key = kept.store, kept.key
        with store.alone(key) as written:
            found = kept.loaded(written)
            if found is None:
                with compiling():
                    made = make()
                kept.written(_content(made, self, kept.fingerprint.reached))
                found = _as_made(made, self)
        return found

    def program_of_rows(self, rows: tuple[bool, ...], count: int) -> native.Program | None:
        """The natively compiled program of this many rows, which XLA may call too, if there is one.

        - ``rows``: which arrays have rows as leading axis.
        """
        several = self.in_lanes and any(rows) and count > 1
        for computation in (*((self.block(rows),) if several else ()), self):
            program = computation.program()
            if program is not None and program.target is not None:
                return program
        return None

    # Computations that follow from it

    @functools.cached_property
    def _followers(self) -> dict[Any, "Computation"]:
        return {}

    def _following(self, key: Any, make: Callable[[], "Computation"]) -> "Computation":
        if key not in self._followers:
            self._followers.setdefault(key, make())
        return self._followers[key]

    def _made_of(self, function: Callable[[list[Any]], Any], arrays: Sequence[Any], gives: Sequence[Any]) -> Any:
        made = Computation(
            function,
            arrays,
            name=self.name,
            large=self.large,
            in_lanes=self.in_lanes,
            together=self.together,
            opaque=self.opaque,
            gives=[_strong(one) for one in gives],
        )
        made.is_derivative = self.is_derivative
        return made

    def tangents(self, which: tuple[bool, ...]) -> "Computation":
        """The tangents of the results that have some, of the arrays and the tangents of those chosen by ``which``."""

        def make() -> Computation:
            function = functools.partial(_tangents, self.smooth, which)
            moving = chosen(self.takes, which)
            made = self._made_of(function, [*self.takes, *moving], list(filter(_has_tangents, self.gives)))
            made.linear, made.is_derivative = (False,) * len(which) + (True,) * len(moving), True
            return made

        return self._following(("tangents", which), make)

    def cotangents(self, which: tuple[bool, ...], of: tuple[bool, ...]) -> "Computation":
        """The cotangents of the arrays chosen by ``which``, of all arrays and the cotangents of some results.

        - ``of``: which results, among those that have tangents.
        """

        def make() -> Computation:
            by_tangents = functools.partial(_cotangents_by_tangents, self.smooth, which, of)
            going_back = functools.partial(_cotangents, _Traced(self), which, of)
            given = chosen(list(filter(_has_tangents, self.gives)), of)
            function = by_tangents if self.is_derivative else going_back
            made = self._made_of(function, [*self.takes, *given], chosen(self.takes, which))
            made.smooth = by_tangents
            made.linear, made.is_derivative = (False,) * len(which) + (True,) * len(given), True
            return made

        return self._following(("cotangents", which, of), make)

    def directions(self, mapped: tuple[bool, ...], count: int) -> "Computation":
        """The same of as many of the ``mapped`` arrays, which are linear, so that the rest is computed once."""

        def make() -> Computation:
            function, smooth = (functools.partial(_in_directions, f, mapped) for f in (_Traced(self), self.smooth))
            takes = [_in_rows(one, count) if many else one for one, many in zip(self.takes, mapped, strict=True)]
            made = self._made_of(function, takes, [_in_rows(one, count) for one in self.gives])
            made.smooth, made.linear = smooth, self.linear
            return made

        return self._following(("directions", mapped, count), make)

    def block(self, taken: tuple[bool, ...]) -> "Computation":
        """The same of a block of rows; ``taken`` says which arrays have them as leading axis."""

        def make() -> Computation:
            takes = [_in_rows(one, BLOCK) if many else one for one, many in zip(self.takes, taken, strict=True)]
            function = functools.partial(_of_each_row, _Traced(self), taken)
            made = self._made_of(function, takes, [_in_rows(one, BLOCK) for one in self.gives])
            made.rows, made.large = native.Rows(BLOCK, taken), True
            return made

        return self._following(("block", taken), make)


class _Traced:
    """The function of a computation, which is not traced again."""

    follows = ("_computation",)  # what does not determine what it computes

    def __init__(self, computation: Computation):
        self._function, self._computation = computation.function, computation

    def __call__(self, arrays: list[Any]) -> list[Any]:
        return self._computation.here(arrays)


# The functions that computations follow from. They have names, by which a store finds their programs.


def _arrays(result: list[Any] | Result) -> list[Any]:
    return result.arrays if isinstance(result, Result) else result


def _tangents(function: Callable, which: tuple[bool, ...], arrays: list[Any]) -> list[Any]:
    primals, tangents = arrays[: len(which)], arrays[len(which) :]

    def of_moving(*moving: Any) -> list[Any]:
        return list(filter(_has_tangents, _arrays(function(replaced(primals, which, moving)))))

    with differentiated_forward():
        return jax.jvp(of_moving, chosen(primals, which), tangents)[1]


def _cotangents(function: Callable, which: tuple[bool, ...], of: tuple[bool, ...], arrays: list[Any]) -> list[Any]:
    primals, cotangents = arrays[: len(which)], arrays[len(which) :]

    def of_moving(*moving: Any) -> list[Any]:
        results = _arrays(function(replaced(primals, which, moving)))
        return chosen(list(filter(_has_tangents, results)), of)

    return list(jax.vjp(of_moving, *chosen(primals, which))[1](cotangents))


def _cotangents_by_tangents(
    function: Callable, which: tuple[bool, ...], of: tuple[bool, ...], arrays: list[Any]
) -> list[Any]:
    primals, cotangents = arrays[: len(which)], arrays[len(which) :]

    def results(primals: list[Any]) -> list[Any]:
        return chosen(list(filter(_has_tangents, _arrays(function(primals)))), of)

    with differentiated_forward():
        pull = pulled_by_forward_mode(results)
        return chosen(pull((primals, None), cotangents, list(which)), which)


def _in_directions(function: Callable, mapped: tuple[bool, ...], arrays: list[Any]) -> list[Any]:
    return jax.vmap(lambda arrays: _arrays(function(arrays)), in_axes=([0 if many else None for many in mapped],))(
        arrays
    )


def _of_each_row(function: Callable, taken: tuple[bool, ...], arrays: list[Any]) -> list[Any]:
    def of_row(row: list[Any]) -> list[Any]:
        return _arrays(function(replaced(arrays, taken, row)))

    return jax.lax.map(of_row, chosen(arrays, taken))


def _has_tangents(array: Any) -> bool:
    return jnp.issubdtype(array.dtype, jnp.inexact)


def _strong(one: Any) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(one.shape, one.dtype)


def _in_rows(one: Any, rows: int) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct((rows, *one.shape), one.dtype)


class Compiled(NamedTuple):
    """A compiled program, with the parts of its result that are not arrays."""

    made: Any
    result: Rest
    takes_keys: bool = False

    def numbers(self, arrays: list[Any]) -> list[Any]:
        """The arrays of the result, as numbers."""
        if not isinstance(self.made, native.Program):
            arrays = list(map(_as_converted, arrays))
        return self.made(arrays)

    def __call__(self, arrays: list[Any]) -> Any:
        """The result, of arrays that may be random keys."""
        return self.result.joined(self.numbers(list(map(native.numbers, arrays)) if self.takes_keys else arrays))


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

    def found(self) -> Compiled | native.Refusal | None:
        """The program; None if there is none."""
        return _as_kept(self.store.early(self.key), self.fingerprint.reached) or self.loaded(self.store.read(self.key))

    def loaded(self, content: bytes | None) -> Compiled | native.Refusal | None:
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


def _as_made(made: Any, computation: Computation) -> Compiled | native.Refusal:
    return made if isinstance(made, native.Refusal) else Compiled(made, computation.result, computation.takes_keys)


def _content(made: Any, computation: Computation, reached: Sequence[Any]) -> bytes:
    """A program as bytes: empty if it cannot be kept, so that no process waits for another to compile it."""
    if isinstance(made, native.Refusal):
        return executables.content_of_refusal(made)
    takes, gives = len(computation.takes), len(computation.gives)
    return executables.content(made, takes, gives, tuple(computation.result), reached) or b""


def _as_kept(
    loaded: executables.Loaded | native.Refusal | None, reached: Sequence[Any]
) -> Compiled | native.Refusal | None:
    """A loaded program; None if there is none."""
    if isinstance(loaded, executables.Loaded):
        with contextlib.suppress(Exception):  # whatever a class of another version raises
            return Compiled(loaded.executable, Rest(*loaded.result(reached)))
        return None
    return loaded


def _as_converted(array: Any) -> Any:
    """NumPy arrays with the types that JAX converts them to: some of its versions pass a program 64 bits for 32."""
    if isinstance(array, np.ndarray | np.generic):
        return array.astype(jax.dtypes.canonicalize_dtype(array.dtype), copy=False)
    return array


def _describe(takes: Sequence[Any]) -> Iterator[Any]:
    """The properties of the arrays that a program depends on, and JAX's settings, for a key in a store."""
    yield [(one.shape, one.dtype, one.weak_type) for one in takes]
    yield {name: value for name, value in settings().items() if name not in ("jax_default_device", QUICKLY)}


def _kept_by_jax() -> bool:
    """Whether JAX keeps XLA's programs itself: programs loaded from there cannot be written again."""
    config: Any = jax.config
    return bool(config.jax_enable_compilation_cache and config.jax_compilation_cache_dir)
