"""Functions traced for arguments, and their compiled programs."""

import contextlib
import copy
import functools
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...compat import array_type, is_tracer_type, same_mesh, setting_of_traces, trace_context, without_locations
from . import choice
from .collecting import seldom_collected
from .gpu import GridProgram
from .ir.elements import UnsupportedError
from .targets import machine

_OF_NUMPY = (np.ndarray, np.generic, bool, int, float, complex)  # all types other than JAX arrays
_natively = setting_of_traces(False)
_asked: set[int] = set()  # the threads in which `traced_natively` was true since they last began to trace


class _Known(dict):
    """What is known of types, found out once for each: JAX's and NumPy's own tests take a tenth of a short run."""

    def __init__(self, find: Callable[[type], bool]):
        self._find = find

    def __missing__(self, of: type) -> bool:
        self[of] = self._find(of)
        return self[of]


_is_of_numpy = _Known(lambda of: issubclass(of, _OF_NUMPY))
_is_tracer = _Known(is_tracer_type)


class CallbackReachedError(Exception):
    """A native run reached a callback in a branch, such as an error to be raised: XLA runs it, from the beginning."""


class Refusal(NamedTuple):
    """Why a program is not compiled natively: the subject of the sentence "… is not compiled natively"."""

    reason: str


class Form(NamedTuple):
    """A compiled program as plain data.

    - ``takes``: the types of the arrays that it takes.
    - ``gives``: shape, type and whether the type is weak, of the arrays that it gives.
    - ``executable``: a :class:`~.executable.Form`.
    """

    takes: tuple[np.dtype, ...]
    gives: tuple[tuple[tuple[int, ...], np.dtype, bool], ...]
    executable: Any


class Program:
    """A program for arrays of certain types: called with such arrays, it returns JAX arrays.

    **Raises:** :class:`CallbackReachedError`.
    """

    def __init__(self, form: Form):
        from .executable import Executable, Results

        self.form = form
        self._executable = Executable(form.executable)
        self._as_jax = Results([array_type(*given) for given in form.gives])

    def __call__(self, arrays: Sequence[Any]) -> list[jax.Array]:
        results = self._executable(
            [
                np.asarray(array, dtype, order="C") if _is_of_numpy[type(array)] else array
                for array, dtype in zip(arrays, self.form.takes, strict=True)
            ]
        )
        if results is None:
            raise CallbackReachedError
        return self._as_jax(results)

    def of_rows(
        self, arrays: Sequence[Any], in_rows: Sequence[bool], weak: Sequence[bool], threads: int
    ) -> list[jax.Array]:
        """The results of all rows; ``in_rows`` says which arrays have them as leading axis.

        ``weak`` says which results have a weak type.

        Only a program with a :attr:`target` has this. Ctrl-C ends it.
        """
        from .executable import Results

        results = self._executable.of_rows(
            [
                np.asarray(array, dtype, order="C") if _is_of_numpy[type(array)] else array
                for array, dtype in zip(arrays, self.form.takes, strict=True)
            ],
            in_rows,
            threads,
        )
        avals = [array_type(array.shape, array.dtype, is_weak) for array, is_weak in zip(results, weak, strict=True)]
        return Results(avals)(results)

    @functools.cached_property
    def target(self) -> str | None:
        """The name by which XLA calls the program in this process; None if it may stop at a callback of Python."""
        return self._executable.target()


def traced_natively() -> bool:
    """Whether what is being traced is to be compiled natively.

    Then a map of long computations is best a ``jax.lax.map``, whose turns are computed side by side. XLA would compute
    one after the other, and is best given ``jax.vmap``.
    """
    if _natively.value:
        _asked.add(threading.get_ident())
    return _natively.value


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
        def traced(arrays: list[Any]) -> list[Any]:
            return function(arrays)

        self.name = traced.__name__ = traced.__qualname__ = name
        self.function = jax.jit(traced, keep_unused=True)
        self.takes, self._natively = list(map(type_of, arrays)), natively
        self._depends, self._context = False, context

    @functools.cached_property
    def traced(self) -> Any:
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
        """The trace, lowered to StableHLO for a CPU, without calls of libraries that only other devices have."""
        return self.lowered if jax.default_backend() == "cpu" else self._lower("cpu")

    def _lower(self, *platforms: str) -> Any:
        traced = self.traced
        with self.as_traced(), without_locations():
            return traced.lower(lowering_platforms=platforms or None)

    @contextlib.contextmanager
    def as_traced(self) -> Iterator[None]:
        """The context in which it is traced, in which JAX finds the trace again."""
        with seldom_collected(), _natively(self._natively), self._context(), same_mesh():
            yield

    @property
    def gives(self) -> list[Any]:
        """The types of the results."""
        return [type_of(aval) for aval in self.traced.jaxpr.out_avals]

    def natively(self, large: bool = True, quickly: bool = False, rows: Any = None) -> Program | Refusal:
        """The program; a refusal if it contains something unsupported.

        - ``large``: whether it is compiled even if its loops are over large arrays, which XLA runs faster.
        - ``quickly``: whether LLVM optimises it less.
        - ``rows``: what it computes at once, see :class:`~.table.Rows`.
        """
        from .emit import operations  # noqa: F401 (whose rules are entered)
        from .pipeline import compiled

        takes, gives = self.traced.jaxpr.in_avals, self.traced.jaxpr.out_avals
        try:
            with seldom_collected():
                form = Form(
                    tuple(map(_numpy_type, takes)),
                    _described(gives),
                    compiled(self.for_cpu().compiler_ir("stablehlo"), len(takes), large, quickly, rows),
                )
        except UnsupportedError as error:
            return Refusal(str(error))
        return Program(form)

    def for_gpu(self, large: bool) -> GridProgram | Refusal:
        """The program of a GPU's threads, each of which computes a row; otherwise like :meth:`natively`.

        **Raises:** :class:`~.cuda.CudaError` where the driver cannot compile it.
        """
        from .emit import operations  # noqa: F401 (whose rules are entered)
        from .pipeline import compile_for_gpu

        try:
            with seldom_collected():
                gives = _described(self.traced.jaxpr.out_avals)
                module = self.for_cpu().compiler_ir("stablehlo")
                return GridProgram(compile_for_gpu(module, gives, len(self.takes), large))
        except UnsupportedError as error:
            return Refusal(str(error))

    def as_text(self) -> str:
        """The program as LLVM's IR.

        **Raises:** :class:`~.elements.UnsupportedError` if it contains something unsupported.
        """
        from .emit import operations  # noqa: F401 (whose rules are entered)
        from .pipeline import written

        return written(self.lowered.compiler_ir("stablehlo"), len(self.takes)).text()

    def by_xla(self) -> Callable[[list[Any]], list[Any]]:
        """The program."""
        return self.for_xla().lowered.compile()

    def for_xla(self) -> "Lowered":
        """The same, traced for XLA; this one, where that does not matter."""
        if self.traced and not self._depends:
            return self
        again = copy.copy(self)
        again._natively = False
        for name in ("traced", "lowered"):
            vars(again).pop(name, None)
        return again


def type_of(array: Any) -> jax.ShapeDtypeStruct:
    """Shape and type of an array, or of a number that JAX takes for one."""
    if type(array) is jax.ShapeDtypeStruct:
        return array
    weak = getattr(array, "weak_type", type(array) in (bool, int, float, complex))
    dtype = jax.dtypes.canonicalize_dtype(getattr(array, "dtype", None) or np.result_type(type(array)))
    return jax.ShapeDtypeStruct(np.shape(array), dtype, weak_type=bool(weak))


def implementation(array: Any) -> Any:
    """How random keys make numbers; None for anything else."""
    return jax.random.key_impl(array) if _is_key(array) else None


def _is_key(array: Any) -> bool:
    # Types of numbers are NumPy's, and the test of the others takes time that a short program would feel.
    if not isinstance(array, jax.Array) or isinstance(array.dtype, np.dtype):
        return False
    return jnp.issubdtype(array.dtype, jax.dtypes.prng_key)


def numbers(array: Any) -> Any:
    """The numbers of which random keys consist; anything else as it is."""
    return jax.random.key_data(array) if _is_key(array) else array


def as_keys(arrays: Sequence[Any], implementations: Sequence[Any]) -> list[Any]:
    """Random keys of such numbers, where there is one of how they make others."""
    return [
        array if implementation is None else jax.random.wrap_key_data(array, impl=implementation)
        for array, implementation in zip(arrays, implementations, strict=True)
    ]


def warn_if_asked_for(refusal: Refusal, name: str) -> None:
    """Warns why XLA compiles the program with this name, if the native compiler was chosen by name."""
    if choice.asked_for() == "native":
        message = f"{refusal.reason} is not compiled natively: XLA compiles the program `{name}`."
        warnings.warn(message, stacklevel=4)


def allowed() -> bool:
    """Whether programs are compiled natively at all."""
    return machine.is_present() and on_one_cpu()


def allowed_on_gpu() -> bool:
    """Whether programs are compiled natively for NVIDIA's GPUs."""
    if not machine.is_present() or _is_debugging():
        return False
    from .gpu import why_not

    return why_not() is None


def identity_on_gpu() -> list[str]:
    """What, besides its text, determines the code of a program for a GPU."""
    from .gpu import identity

    return identity()


def usable(leaves: Sequence[Any]) -> bool:
    """Whether programs can be compiled natively for such arguments: on the one device of a CPU, and with numbers."""
    return allowed() and not some_traced(leaves) and are_numbers(leaves)


def are_numbers(leaves: Sequence[Any]) -> bool:
    """Whether all leaves are numbers, arrays of numbers, or random keys."""
    return all(map(_is_numbers, leaves))


def on_one_cpu() -> bool:
    """Whether programs run on the one device of a CPU, and without settings that are for debugging."""
    config: Any = jax.config
    if _is_debugging():
        return False
    if not jax.sharding.get_abstract_mesh().empty or jax.default_backend() != "cpu" or jax.device_count() != 1:
        return False
    return config.jax_default_device in (None, "cpu", jax.devices()[0])


def _is_debugging() -> bool:
    config: Any = jax.config
    return config.jax_debug_nans or config.jax_debug_infs or config.jax_disable_jit


def _is_numbers(leaf: Any) -> bool:
    if isinstance(leaf, jax.Array | np.ndarray | np.generic):
        return _is_key(leaf) or (isinstance(leaf.dtype, np.dtype) and leaf.dtype.kind in "biufc")
    return isinstance(leaf, bool | int | float | complex)


def some_traced(leaves: Sequence[Any]) -> bool:
    """Whether any of the leaves is traced."""
    return any(_is_tracer[of] for of in set(map(type, leaves)))


def kind(array: Any) -> Any:
    """The properties of an argument that a program depends on, for a key within a process."""
    if isinstance(array, np.ndarray):
        return array.shape, array.dtype
    return getattr(array, "aval", None) or type(array)


def settings() -> Any:
    """The settings of JAX that determine, within a process, which program is run."""
    config: Any = jax.config
    debugging = config.jax_debug_nans, config.jax_debug_infs, config.jax_disable_jit
    return trace_context(), config.jax_default_device, debugging


def _described(avals: Sequence[Any]) -> tuple[tuple[tuple[int, ...], np.dtype, bool], ...]:
    return tuple((aval.shape, _numpy_type(aval), aval.weak_type) for aval in avals)


def _numpy_type(aval: Any) -> np.dtype:
    if not isinstance(aval.dtype, np.dtype):  # such as random keys
        raise UnsupportedError(f"An array of {aval.dtype}")
    return aval.dtype
