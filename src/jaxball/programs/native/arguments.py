"""Arguments of programs: numbers, arrays and random keys, and their types."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...interface.compat import is_array_type, is_tracer_type

_OF_NUMPY = (np.ndarray, np.generic, bool, int, float, complex)  # all types other than JAX arrays


class _Test(dict):
    """A test of types, made once for each type: JAX's and NumPy's own tests take a tenth of a short run."""

    def __init__(self, find: Callable[[type], bool]):
        self._find = find

    def __missing__(self, of: type) -> bool:
        self[of] = self._find(of)
        return self[of]


_is_of_numpy = _Test(lambda of: issubclass(of, _OF_NUMPY))
_is_tracer = _Test(is_tracer_type)
_is_key_or_tracer = _Test(lambda of: not (_is_of_numpy[of] or is_array_type(of)))


def is_of_numpy(of: type) -> bool:
    """Tells whether a type is one of NumPy's or Python's, whose numbers JAX takes."""
    return _is_of_numpy[of]


def type_of(array: Any) -> jax.ShapeDtypeStruct:
    """Returns shape and type of an array, or of a number that JAX takes for one."""
    if type(array) is jax.ShapeDtypeStruct:
        return array
    weak = getattr(array, "weak_type", type(array) in (bool, int, float, complex))
    dtype = jax.dtypes.canonicalize_dtype(getattr(array, "dtype", None) or np.result_type(type(array)))
    return jax.ShapeDtypeStruct(np.shape(array), dtype, weak_type=bool(weak))


def implementations(arrays: Sequence[Any]) -> tuple[Any, ...]:
    """Returns how each array makes random numbers, if it consists of random keys; empty where none does."""
    if not any(_is_key_or_tracer[of] for of in set(map(type, arrays))):
        return ()
    found = tuple(jax.random.key_impl(array) if _is_key(array) else None for array in arrays)
    return found if any(found) else ()


def _is_key(array: Any) -> bool:
    # Types of numbers are NumPy's, and the test of the others takes time that a short program would feel.
    if not isinstance(array, jax.Array) or isinstance(array.dtype, np.dtype):
        return False
    return jnp.issubdtype(array.dtype, jax.dtypes.prng_key)


def numbers(array: Any) -> Any:
    """Returns the numbers of which random keys consist; anything else as it is."""
    return jax.random.key_data(array) if _is_key(array) else array


def as_keys(arrays: Sequence[Any], implementations: Sequence[Any]) -> list[Any]:
    """Makes random keys of such numbers, where it is known how they make others."""
    return [
        array if implementation is None else jax.random.wrap_key_data(array, impl=implementation)
        for array, implementation in zip(arrays, implementations, strict=True)
    ]


def are_numbers(leaves: Sequence[Any]) -> bool:
    """Returns whether all leaves are numbers, arrays of numbers, or random keys."""
    return all(map(_is_numbers, leaves))


def _is_numbers(leaf: Any) -> bool:
    if isinstance(leaf, jax.Array | np.ndarray | np.generic):
        return _is_key(leaf) or (isinstance(leaf.dtype, np.dtype) and leaf.dtype.kind in "biufc")
    return isinstance(leaf, bool | int | float | complex)


def some_traced(leaves: Sequence[Any]) -> bool:
    """Returns whether any of the leaves is traced."""
    return any(_is_tracer[of] for of in set(map(type, leaves)))


def kind(array: Any) -> Any:
    """Returns the properties of an argument that a program depends on, for a key within a process."""
    if isinstance(array, np.ndarray):
        return array.shape, array.dtype
    return getattr(array, "aval", None) or type(array)
