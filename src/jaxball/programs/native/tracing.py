"""Traces a function for arrays of certain types, and has either compiler make a program of it.

Meanwhile Python's garbage collector runs less often.
"""

import contextlib
import copy
import functools
import gc
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np

from ...interface.compat import same_mesh, without_locations
from .. import traces
from .arguments import type_of
from .choice import Refusal
from .executable import Executable, Given
from .gpu import GridExecutable
from .ir.elements import UnsupportedError

SELDOM = (50_000, 50, 50)  # objects between two searches, and searches between two that look further back
_lock = threading.Lock()
_running, _usual = 0, SELDOM  # how many blocks search less often, and the thresholds outside of them
_asked: set[int] = set()  # the threads in which `is_traced_natively` was true since they last began to trace


def is_traced_natively() -> bool:
    """Returns whether the function being traced is to be compiled natively.

    Then a map of long computations is best a ``jax.lax.map``, whose turns are computed side by side. XLA would compute
    one after the other, and is best given ``jax.vmap``.
    """
    if traces.natively.value:
        _asked.add(threading.get_ident())
    return traces.natively.value


class Lowered:
    """A function of a list of arrays, traced for arrays of certain types, to be compiled by either compiler.

    **Arguments:**

    - ``function``: of a list of arrays, and returns one.
    - ``arrays``: such arrays, or what ``jax.eval_shape`` gives of such.
    - ``natively``: whether it is traced for the native compiler; if XLA compiles it in the end, it may be traced again.
    - ``context``: in which it is traced, too.
    """

    def __init__(
        self,
        function: Callable[[list[Any]], list[Any]],
        arrays: Sequence[Any],
        name: str,
        natively: bool = True,
        context: Callable[[], contextlib.AbstractContextManager[Any]] = contextlib.nullcontext,
    ):
        def call(arrays: list[Any]) -> list[Any]:
            return function(arrays)

        self.name = call.__name__ = call.__qualname__ = name
        # All arguments stay, because the program is called with all of them.
        self.function = jax.jit(call, keep_unused=True)
        self.takes, self._natively = list(map(type_of, arrays)), natively
        self._depends, self._context = False, context

    @functools.cached_property
    def trace(self) -> Any:
        """The trace."""
        _asked.discard(threading.get_ident())
        with self.as_traced():
            traced = self.function.trace(self.takes)
        self._depends = threading.get_ident() in _asked
        return traced

    @functools.cached_property
    def lowered(self) -> Any:
        """The trace, lowered to StableHLO for the device that JAX computes on."""
        return self._lower()

    def for_cpu(self) -> Any:
        """Returns the trace, lowered to StableHLO for a CPU, without calls of libraries that only other
        devices have.
        """
        return self.lowered if jax.default_backend() == "cpu" else self._lower("cpu")

    def _lower(self, *platforms: str) -> Any:
        traced = self.trace
        with self.as_traced(), without_locations():
            return traced.lower(lowering_platforms=platforms or None)

    @contextlib.contextmanager
    def as_traced(self) -> Iterator[None]:
        """Enters the context in which it is traced, in which JAX finds the trace again."""
        with seldom_collected(), traces.natively(self._natively), self._context(), same_mesh():
            yield

    @property
    def gives(self) -> list[Any]:
        """The types of the results."""
        return [type_of(aval) for aval in self.trace.jaxpr.out_avals]

    def compile_natively(self, large: bool = True, quickly: bool = False, rows: Any = None) -> Executable | Refusal:
        """Returns the program; a refusal if it contains something unsupported.

        - ``large``: whether it is compiled even if its loops are over large arrays, which XLA runs faster.
        - ``quickly``: whether LLVM optimises it less.
        - ``rows``: what it computes at once, see :class:`~.handler.Rows`.
        """
        from .pipeline import compile_for_cpu

        try:
            with seldom_collected():
                takes = list(map(_numpy_type, self.trace.jaxpr.in_avals))
                gives = _describe_results(self.trace.jaxpr.out_avals)
                module = self.for_cpu().compiler_ir("stablehlo")
                form = compile_for_cpu(module, takes, gives, large=large, quickly=quickly, rows=rows)
                return Executable(form)
        except UnsupportedError as error:
            return Refusal(str(error))

    def compile_for_gpu(self, large: bool) -> GridExecutable | Refusal:
        """Returns the program of a GPU's threads, each of which computes a row; otherwise
        like :meth:`compile_natively`.

        **Raises:** :class:`~.cuda.CudaError` where the driver cannot compile it.
        """
        from .pipeline import compile_for_gpu

        try:
            with seldom_collected():
                gives = _describe_results(self.trace.jaxpr.out_avals)
                module = self.for_cpu().compiler_ir("stablehlo")
                return GridExecutable(compile_for_gpu(module, len(self.takes), gives, large))
        except UnsupportedError as error:
            return Refusal(str(error))

    def as_text(self) -> str:
        """Returns the program as LLVM's IR.

        **Raises:** :class:`~.elements.UnsupportedError` if it contains something unsupported.
        """
        from .pipeline import cpu_text, emit, read_functions

        return cpu_text(emit(read_functions(self.lowered.compiler_ir("stablehlo"), len(self.takes))))

    def compile_by_xla(self) -> Callable[[list[Any]], list[Any]]:
        """Returns the program."""
        return self.for_xla().lowered.compile()

    def for_xla(self) -> "Lowered":
        """Returns the same, traced for XLA; this one, where that does not matter."""
        # A function that asked who compiles it may have been traced differently for the other one.
        if self.trace and not self._depends:
            return self
        again = copy.copy(self)
        again._natively = False
        for name in ("trace", "lowered"):
            vars(again).pop(name, None)
        return again


def _describe_results(avals: Sequence[Any]) -> list[Given]:
    return [(aval.shape, _numpy_type(aval), aval.weak_type) for aval in avals]


def _numpy_type(aval: Any) -> np.dtype:
    if not isinstance(aval.dtype, np.dtype):  # such as random keys
        raise UnsupportedError(f"An array of {aval.dtype}")
    return aval.dtype


@contextlib.contextmanager
def seldom_collected() -> Iterator[None]:
    """Makes Python search for garbage less often within this block. Used around functions that trace or compile, also
    as a decorator.

    They make hundreds of thousands of objects, most of which live on. By Python's own thresholds these are looked
    through again and again, which takes an eighth to a fifth of the time. The thresholds are those of the process:
    threads share the block, which ends with the last of them. A search that the user has switched off, or made more
    seldom, stays so.
    """
    global _running, _usual
    with _lock:
        _running += 1
        if _running == 1:
            _usual = gc.get_threshold()
            gc.set_threshold(*_at_least(_usual))
    try:
        yield
    finally:
        with _lock:
            _running -= 1
            if _running == 0 and gc.get_threshold() == _at_least(_usual):  # the user may have changed them meanwhile
                gc.set_threshold(*_usual)


def _at_least(thresholds: tuple[int, int, int]) -> tuple[int, int, int]:
    young, middle, old = map(max, thresholds, SELDOM)
    return (young, middle, old) if thresholds[0] else thresholds
