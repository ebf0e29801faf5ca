"""``jit`` and ``filter_jit``, by which jaxball compiles its functions: like those of JAX and equinox, with a store.

If the native compiler is chosen (:mod:`jaxball.programs.native`), XLA compiles only programs that it does not support
and, unless it was chosen by name, programs whose loops are over large arrays, as for many runs side by side. Each is
traced once. Within a trace of JAX, a call is one operation of the traced program (:mod:`~.operation`), which XLA hands
over to the same program. On devices other than a single CPU, XLA compiles the functions.
"""

import contextlib
import functools
import weakref
from collections.abc import Callable, Iterator
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from ..interface.compat import is_within_trace, settings
from . import native, traces
from .compiled import QUICKLY, Compiled, Rest
from .computation import ROWS_OF_XLA, Computation, call_with, take_arrays
from .derivatives.steering import is_steered_from_outside
from .identity.closures import put_captures, take_captures
from .operation import may_be_an_operation, operation
from .store import current
from .store.current import Store

P = ParamSpec("P")
T = TypeVar("T")
_MISSING: Any = object()
_PART_OF_TRACE: Any = object()
_made: "weakref.WeakSet[Program]" = weakref.WeakSet()


def forget() -> None:
    """Drops the programs of all functions, which are then compiled or loaded again."""
    for program in list(_made):
        program.forget()


def jit(
    function: Callable[P, T],
    *,
    in_lanes: bool = True,
    together: int = ROWS_OF_XLA,
    steered: bool = False,
    by_steps: bool = False,
) -> "Program":
    """Compiles like ``jax.jit``: all leaves of all arguments are arrays. The values that ``function`` holds distinguish
    programs.

    - ``in_lanes``: whether ``jax.vmap`` of it computes several rows side by side, in vectors.
    - ``together``: how many rows are computed side by side where XLA compiles it for a CPU.
    - ``steered``: whether it has loops whose steps are chosen for its derivatives as well.
    - ``by_steps``: whether its results list such steps.
    """
    how: dict[str, Any] = {"in_lanes": in_lanes, "together": together, "steered": steered, "by_steps": by_steps}
    return Program(function, jax.jit(function), None, **how)


def filter_jit(function: Callable[P, T]) -> Callable[P, T]:
    """Compiles like ``equinox.filter_jit``: the arrays of all arguments are traced, and all else distinguishes
    programs.
    """
    return Program(function, eqx.filter_jit(function), eqx.is_array)


@contextlib.contextmanager
def compile_quickly(wanted: bool = True) -> Iterator[None]:
    """Compiles programs that are first used in this block in less time; they run longer.

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


class Program:
    """A function, and its computations by the kinds of their arguments.

    - ``large``: whether what has loops over large arrays is compiled natively, too.
    - ``in_lanes``: whether several rows of arguments are computed side by side, in vectors.
    - ``together``: how many rows are computed side by side where XLA compiles it for a CPU.
    - ``opaque``: whether all within is one program, as in jaxball's own functions.
    - ``steered``: whether it has loops whose steps are chosen for its derivatives as well.
    - ``by_steps``: whether its results list such steps.
    """

    follows = "_programs", "_computations", "_open", "_closed", "_store"  # what does not determine what it computes

    def __init__(
        self,
        function: Callable[..., Any],
        compiled: Callable[..., Any],
        is_dynamic: Callable[[Any], bool] | None,
        *,
        large: bool = False,
        in_lanes: bool = True,
        together: int = ROWS_OF_XLA,
        opaque: bool = True,
        steered: bool = False,
        by_steps: bool = False,
    ):
        self._function, self._compiled, self._is_dynamic = function, compiled, is_dynamic
        how = {"large": large, "in_lanes": in_lanes, "together": together, "opaque": opaque, "steered": steered}
        self._how: dict[str, Any] = how | {"by_steps": by_steps}
        self._programs: dict[Any, Compiled | None] = {}
        self._computations: dict[Any, Computation] = {}
        self._open: dict[Any, Program] = {}
        self._closed: set[Rest] = set()
        self._store: Store | None = None
        wrapped = function.func if isinstance(function, functools.partial) else function
        functools.update_wrapper(self, wrapped, updated=())  # whose attributes may be those of another of this class
        _made.add(self)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        if self._how["steered"] and traces.finer.value is not None:
            with traces.finer(None):  # Its tolerances are arguments, so that the program is the same.
                return self(*args, **kwargs)
        leaves, structure = jax.tree.flatten((args, kwargs))
        rest, arrays = take_arrays(leaves, structure, self._is_dynamic)
        if self._how["opaque"] and not self._is_written_out() and not self._is_closed(rest):
            call = self._function, args, kwargs
            opened, captures = take_captures(call, local=True)
            if opened is not call:
                function, args, kwargs = opened
                return self._of_captures(function)(captures, args, kwargs)
            self._closed.add(rest)
        program = _PART_OF_TRACE if native.some_traced(leaves) else self._program_for(rest, arrays)
        if program is _PART_OF_TRACE:
            result = self._join_trace(rest, arrays)
            return self._compiled(*args, **kwargs) if result is None else result[0]
        if program is not None:
            with contextlib.suppress(native.CallbackReachedError):
                return _run(program, rest, arrays)
        return self._compiled(*args, **kwargs)

    def _is_written_out(self) -> bool:
        """Returns whether a call is a part of the computation that is being traced, and no operation of its own.

        What is steered is one there, too, so that its derivatives are those of the same call elsewhere: with the same
        probe, and so in the same steps. Where something else steers it, it has none of its own.
        """
        has_own_probe = self._how["steered"] and not is_steered_from_outside()
        return traces.within_a_computation.value and not has_own_probe

    def _is_closed(self, rest: Rest) -> bool:
        """Returns whether the function and such arguments are known to hold no function that is written
        within another.
        """
        try:
            return rest in self._closed
        except TypeError:  # something has no hash, so that its programs are not found again
            return not is_within_trace()

    def _of_captures(self, function: Any) -> "Program":
        """Returns the program that takes captures as its first argument.

        - ``function``: its own function, from which captures have been taken.
        """
        key = function
        if isinstance(function, functools.partial):  # which is only equal to itself
            key = function.func, function.args, tuple(function.keywords.items())
        try:
            program = self._open.get(key)
        except TypeError:  # it has no hash
            program = None
        if program is None:
            whole = functools.partial(_with_captures, function)
            functools.update_wrapper(whole, self, updated=())
            del whole.__dict__["__wrapped__"]  # whose signature equinox would take for this one
            compiled = jax.jit(whole) if self._is_dynamic is None else eqx.filter_jit(whole)
            program = Program(whole, compiled, self._is_dynamic, **self._how)
            with contextlib.suppress(TypeError):
                self._open[key] = program
        return program

    def forget(self) -> None:
        """Drops all programs of this function."""
        for cache in (self._programs, self._computations, self._open, self._closed):
            cache.clear()

    def _join_trace(self, rest: Rest, arrays: list[Any]) -> tuple[Any] | None:
        """Returns the result of the call as one operation of the traced program; None where it has to be
        written out.
        """
        if self._is_written_out() or not may_be_an_operation():
            return None
        self._follow_store()
        numbers = [native.numbers(array) if isinstance(array, jax.Array) else jnp.asarray(array) for array in arrays]
        computation = self._computation(rest, numbers)
        if computation is None:
            return None
        result, captures = computation.result, computation.captures
        if captures:
            self._computations = {key: other for key, other in self._computations.items() if other is not computation}
            if not native.are_numbers(captures):
                return None
            computation, numbers = computation.of_captures(numbers)
        if not computation.is_pure():
            return None
        return (result.with_keys(operation(computation, numbers)),)

    def _program_for(self, rest: Rest, arrays: list[Any]) -> Any:
        """Returns the program for such arguments; None if JAX compiles it as usual.

        ``_PART_OF_TRACE`` if the function has captured something traced.
        """
        self._follow_store()
        kinds = tuple(map(native.kind, arrays))
        key = (native.explicit_choice(), rest, tuple(map(type, rest.static)), kinds, native.settings())
        try:
            program = self._programs.get(key, _MISSING)
        except TypeError:  # something has no hash
            return None
        if program is not _MISSING:
            return program
        quickly = settings()[QUICKLY]
        if quickly:
            key = key, QUICKLY
            program = self._programs.get(key, _MISSING)
        if program is _MISSING:
            program = self._make_for(rest, arrays)
            if program is not _PART_OF_TRACE:  # which is not kept: it will not be called again
                program = self._programs.setdefault(key, program)
        return program

    def _make_for(self, rest: Rest, arrays: list[Any]) -> Any:
        if not native.are_numbers(arrays):
            return None
        computation = self._computation(rest, [native.type_of(native.numbers(array)) for array in arrays])
        if computation is None:
            return None
        if is_within_trace() and computation.captures:
            return _PART_OF_TRACE
        return computation.obtain(self._store)

    def _follow_store(self) -> None:
        """Drops what is not of the current store."""
        if (store := current.store()) is not self._store:
            self._programs, self._computations, self._store = {}, {}, store

    def _computation(self, rest: Rest, numbers: list[Any]) -> Computation | None:
        """Returns the function of arrays of such types; None if something has no hash."""
        described = tuple((array.shape, array.dtype, array.weak_type) for array in numbers)
        key = native.explicit_choice(), rest, tuple(map(type, rest.static)), described, native.settings()
        try:
            computation = self._computations.get(key)
        except TypeError:
            return None
        if computation is None:
            function = functools.partial(call_with, self._function, self._is_dynamic, rest)
            candidate = Computation(
                function, list(map(native.type_of, numbers)), name=getattr(self, "__name__", "program"), **self._how
            )
            computation = self._computations.setdefault(key, candidate)
        return computation


def _with_captures(function: Any, captures: list[Any], args: Any, kwargs: Any) -> Any:
    function, args, kwargs = put_captures((function, args, kwargs), captures)
    return function(*args, **kwargs)


def _run(program: Compiled, rest: Rest, arrays: list[Any]) -> Any:
    """Returns the result of arguments that may be random keys."""
    return program.result.with_keys(program.run(list(map(native.numbers, arrays)) if rest.keys else arrays))
