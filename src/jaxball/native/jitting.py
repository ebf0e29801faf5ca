"""Functions compiled when they are called, as of ``jax.jit``."""

import functools
import warnings
from collections.abc import Callable, Sequence
from typing import Any, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ..compat import is_traced, trace_context
from . import choice, machine
from .elements import UnsupportedError

P = ParamSpec("P")
T = TypeVar("T")
_OF_NUMPY = (np.ndarray, np.generic, bool, int, float, complex)  # all that is no array of JAX


def jit(function: Callable[P, T]) -> Callable[P, T]:
    """As ``jax.jit``, compiled for the processor in a fraction of the time that XLA takes.

    It is meant for programs of many operations on few numbers: simulations, their derivatives,
    ``jaxball.jit(jax.grad(loss))``, loops. Arrays of up to some thousand numbers are well; large products of matrices
    and long arrays are computed one number after another, and ``jax.jit`` has them faster.

    - ``function``: a pure function of PyTrees of arrays. Within another transformation of JAX, on another device than
      one CPU, and where the program contains what is not compiled natively, it is ``jax.jit(function)``.

    Several threads can run it at once, and Ctrl-C ends a run.

    **Example:**

    >>> import jax
    >>> import jaxball
    >>> f = jaxball.jit(jax.grad(lambda x: x**3))
    >>> print(f(2.0))
    12.0
    """
    return _Jitted(function)


class _Jitted:
    def __init__(self, function: Callable[..., Any]):
        self._function, self._xla = function, jax.jit(function)
        self._programs: dict[Any, tuple[Program, Any] | None] = {}
        functools.update_wrapper(self, function, updated=())  # whose attributes may be those of another of this class

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        leaves, structure = jax.tree.flatten((args, kwargs))
        if choice.asked_for() == "xla" or not allowed() or any(map(is_traced, leaves)):
            return self._xla(*args, **kwargs)
        key = (structure, tuple(map(kind, leaves)), settings())
        if key not in self._programs:
            if not usable(leaves):
                return self._xla(*args, **kwargs)
            self._programs[key] = self._compiled(structure, leaves)
        found = self._programs[key]
        if found is None:
            return self._xla(*args, **kwargs)
        program, result = found
        return result.unflatten(program(leaves))

    def _compiled(self, structure: Any, leaves: list[Any]) -> "tuple[Program, Any] | None":
        results = []

        def of_leaves(leaves: list[Any]) -> list[Any]:
            args, kwargs = structure.unflatten(leaves)
            arrays, result = jax.tree.flatten(self._function(*args, **kwargs))
            results.append(result)
            return arrays

        program = compiled(of_leaves, leaves, getattr(self, "__name__", "program"))
        return None if program is None else (program, results[-1])


class Program:
    """A program for arrays of certain types: called with such, it gives arrays of JAX.

    Where it comes to a callback in a branch, as of an error that is raised, XLA runs it, from the beginning.
    """

    def __init__(self, function: Callable[[list[Any]], list[Any]], arrays: Sequence[Any]):
        from . import operations  # noqa: F401 (whose rules are entered)
        from .executable import Executable

        keys = list(map(_implementation, arrays))
        made: list[list[Any]] = []

        def of_numbers(arrays: list[Any]) -> list[Any]:
            results = function(_as_keys(arrays, keys))
            made.append(list(map(_implementation, results)))
            return list(map(_numbers, results))

        self._xla = jax.jit(of_numbers, keep_unused=True)
        traced = self._xla.trace(list(map(_numbers, arrays)))
        self._keys, self._made = any(keys), made[-1] if any(made[-1]) else None
        self._types = [np.dtype(_numpy_type(aval)) for aval in traced.jaxpr.in_avals]
        self._avals = traced.jaxpr.out_avals
        for aval in self._avals:
            _numpy_type(aval)
        self._executable = Executable(traced.lower().compiler_ir("stablehlo"), len(arrays))

    def __call__(self, arrays: Sequence[Any]) -> list[jax.Array]:
        from .executable import as_jax

        arrays = list(map(_numbers, arrays)) if self._keys else arrays
        given = [
            np.asarray(array, dtype, order="C") if isinstance(array, _OF_NUMPY) else array
            for array, dtype in zip(arrays, self._types, strict=True)
        ]
        results = self._executable(given)
        results = self._xla(list(arrays)) if results is None else as_jax(results, self._avals)
        return results if self._made is None else _as_keys(results, self._made)


def _implementation(array: Any) -> Any:
    """How random keys make numbers; None of what is none."""
    return jax.random.key_impl(array) if _is_key(array) else None


def _is_key(array: Any) -> bool:
    return isinstance(array, jax.Array) and jnp.issubdtype(array.dtype, jax.dtypes.prng_key)


def _numbers(array: Any) -> Any:
    """The numbers of which random keys consist; anything else as it is."""
    return jax.random.key_data(array) if _is_key(array) else array


def _as_keys(arrays: Sequence[Any], implementations: Sequence[Any]) -> list[Any]:
    """Random keys of such numbers, where there is one of how they make others."""
    return [
        array if implementation is None else jax.random.wrap_key_data(array, impl=implementation)
        for array, implementation in zip(arrays, implementations, strict=True)
    ]


def compiled(function: Callable[[list[Any]], list[Any]], arrays: Sequence[Any], name: str) -> Program | None:
    """A function of a list of arrays as a program for such; None where that is not known how.

    **Warns** where the native compiler was asked for by name, with what it does not know.
    """
    try:
        return Program(function, arrays)
    except UnsupportedError as error:
        if choice.asked_for() == "native":
            message = f"{error} is not compiled natively: XLA compiles the program `{name}`."
            warnings.warn(message, stacklevel=4)
        return None


def allowed() -> bool:
    """Whether programs are compiled natively: for the one device of a CPU, without settings that are for debugging."""
    config: Any = jax.config
    if not machine.is_present() or jax.default_backend() != "cpu" or jax.device_count() != 1:
        return False
    return not (config.jax_debug_nans or config.jax_debug_infs or config.jax_disable_jit)


def usable(leaves: Sequence[Any]) -> bool:
    """Whether programs can be compiled natively for such arguments, which are numbers."""
    return allowed() and not any(map(is_traced, leaves)) and all(map(_is_numbers, leaves))


def _is_numbers(leaf: Any) -> bool:
    if isinstance(leaf, jax.Array | np.ndarray | np.generic):
        return _is_key(leaf) or (isinstance(leaf.dtype, np.dtype) and leaf.dtype.kind in "biufc")
    return isinstance(leaf, bool | int | float | complex)


def kind(array: Any) -> Any:
    """What a program knows of an argument."""
    if isinstance(array, np.ndarray):
        return array.shape, array.dtype
    return array.aval if isinstance(array, jax.Array) else type(array)


def settings() -> Any:
    """The settings of JAX on which a program depends."""
    return trace_context()


def _numpy_type(aval: Any) -> np.dtype:
    if not isinstance(aval.dtype, np.dtype):
        raise UnsupportedError(f"An array of {aval.dtype}")
    return aval.dtype
