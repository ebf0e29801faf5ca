"""Converts numbers that users give to arrays, with checks of types and shapes."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int
from typing_extensions import TypeAliasType

from ..interface.arguments import refusal
from ..interface.compat import is_traced as is_traced
from ..interface.printing import is_array

T = TypeVar("T")
AnyArray = Array | np.ndarray
# A number, an array, or nested sequences of numbers; an alias with a name, which help() shows.
Numbers = TypeAliasType("Numbers", ArrayLike | Sequence[Any])


def default_dtype() -> np.dtype:
    """Returns float64 where x64 is enabled, else float32."""
    return jax.dtypes.canonicalize_dtype(np.float64)


def to_array(x: Numbers, name: str = "x") -> Float[Array, "..."]:
    """Converts ``x`` to an array of the default floating type.

    **Raises:** a ``TypeError`` that names the argument if it is not made of real numbers.
    """
    require_numbers(name, x)
    dtype = default_dtype()
    try:
        if not any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(x)):
            x = np.asarray(x, dtype)  # NumPy, unlike JAX, compiles no program for this
        return jnp.asarray(x, dtype=dtype)
    # A `TypeError`, too, whose own message says what a traced value cannot do.
    except jax.errors.JAXTypeError:
        raise
    except (TypeError, ValueError):
        raise refusal(name, "numbers", x) from None


def namespace_of(x: Any) -> Any:
    """Returns the namespace for ``x``: NumPy for a NumPy array, without compiling anything, otherwise ``jax.numpy``."""
    return np if isinstance(x, np.ndarray | np.generic) else jnp


def require_numbers(name: str, x: Any) -> None:
    """Raises a ``TypeError`` for text, complex numbers, and anything else that would silently become wrong numbers."""
    if not _is_real(x):
        raise refusal(name, "numbers", x)


def require_not_nan(name: str, value: Any) -> None:
    """Raises a ``ValueError`` for an array one of whose entries is NaN; what is traced, or no array, passes."""
    if isinstance(value, jax.Array | np.ndarray) and not is_traced(value) and np.any(np.isnan(np.asarray(value))):
        raise ValueError(f"Argument `{name}` must be {'a number' if value.ndim == 0 else 'numbers'}, but it is nan.")


def to_numpy(x: Numbers, name: str = "x") -> Float[np.ndarray, "..."]:
    """Converts ``x``, which must not be traced, to an array of NumPy in float64.

    **Raises:** as :func:`to_array`.
    """
    require_numbers(name, x)
    try:
        return np.asarray(x, dtype=float)
    except jax.errors.JAXTypeError:
        raise
    except (TypeError, ValueError):
        raise refusal(name, "numbers", x) from None


def join_arrays(parts: Sequence[Float[Array, "_"]]) -> Float[Array, " n"]:
    """Joins the parts one after the other; an empty array of the default type where there are none."""
    return jnp.concatenate(parts) if parts else jnp.zeros((0,), dtype=default_dtype())


def stack_arrays(parts: Sequence[Float[Array, "..."]], shape: tuple[int, ...] = ()) -> Float[Array, "n ..."]:
    """Stacks the parts, each of this shape, side by side; an empty array of the default type where there are none."""
    if not parts:
        return jnp.zeros((0, *shape), default_dtype())
    return jnp.stack(parts) if any(map(is_traced, parts)) else jnp.asarray(np.stack(parts))  # NumPy compiles nothing


def entry(which: Int[Array, ""], values: Float[Array, "k *rest"]) -> Float[Array, "*rest"]:
    """Returns one of several numbers or rows; 0 for none. Not by indexing, which XLA's CPU compiler turns into slow
    loops.
    """
    chosen = jnp.expand_dims(jnp.arange(values.shape[0]) == which, tuple(range(1, values.ndim)))
    return jnp.sum(jnp.where(chosen, values, 0.0), axis=0)


def select_tree(condition: Bool[Array, "..."], first: T, second: T) -> T:
    """Returns a PyTree of the arrays of ``first`` where the condition holds, else of the arrays of ``second``.

    As by ``jnp.where``, but a single condition is not repeated for each element, and then an array that is the same in
    both is taken as it is, so that a state of many arrays is traced in less time.
    """

    def of_each(leaf: Any, other: Any) -> Any:
        alike = jnp.shape(leaf) == jnp.shape(other) and jnp.result_type(leaf) == jnp.result_type(other)
        if jnp.ndim(condition) or not alike:
            return jnp.where(condition, leaf, other)
        return leaf if leaf is other else jax.lax.select(condition, leaf, other)

    return jax.tree.map(of_each, first, second)


def arrays_of(module: Any) -> dict[str, Any]:
    """Returns the fields of a module that are arrays, by name: of a state all those that it has."""
    return {name: value for name, value in vars(module).items() if is_array(value)}


def a_number() -> jax.ShapeDtypeStruct:
    """Returns an abstract number of the default floating type, for tracing a function."""
    return jax.ShapeDtypeStruct((), default_dtype())


def a_vector() -> jax.ShapeDtypeStruct:
    """Returns an abstract vector in space of the default floating type, for tracing a function."""
    return jax.ShapeDtypeStruct((3,), default_dtype())


def _is_real(x: Any) -> bool:
    if isinstance(x, list | tuple):
        return all(map(_is_real, x))
    dtype = getattr(x, "dtype", None)
    if dtype is None:
        return x is not None and not isinstance(x, str | bytes | complex)
    # Types of JAX alone, such as bfloat16, have none of NumPy's letters.
    return getattr(dtype, "kind", None) in {"b", "i", "u", "f"} or jnp.issubdtype(dtype, jnp.floating)


def numbers(name: str, shape: tuple[int | str, ...] = ()) -> Callable[[Numbers], Array]:
    """Returns the conversion of an argument ``name`` to an array of this shape, which has a letter for any length."""

    def convert(x: Numbers) -> Float[Array, "..."]:
        array = to_array(x, name)
        require_shape(name, array, shape)
        return array

    return convert


def positive_number(name: str, x: Numbers) -> Float[Array, ""]:
    """Converts an argument to a number.

    **Raises:** ``ValueError`` for one that is not positive, unless it is traced, and for several.
    """
    value = to_array(x, name)
    if value.ndim or not (is_traced(value) or float(value) > 0):
        raise ValueError(f"Argument `{name}` must be a positive number, but it is {x}.")
    return value


def has_shape(given: tuple[int, ...], shape: tuple[int | str, ...]) -> bool:
    """Returns whether a shape fits the required one, which has a letter for each arbitrary length."""
    return len(given) == len(shape) and all(
        isinstance(length, str) or length == n for length, n in zip(shape, given, strict=True)
    )


def require_shape(name: str, value: Array, shape: tuple[int | str, ...], *, batch: bool = False) -> None:
    """Raises a ``ValueError`` unless the argument ``name`` has the required ``shape``; see ``numbers``."""
    dimensions = value.shape
    tail = dimensions[len(dimensions) - len(shape) :] if batch and len(dimensions) >= len(shape) else dimensions
    if tail == shape or has_shape(tail, shape):
        return
    raise ValueError(f"Argument `{name}` must be {_shape_in_words(shape)}, but its shape is {dimensions}.")


def _shape_in_words(shape: tuple[int | str, ...]) -> str:
    if shape == ():
        return "a single number"
    if shape == (1,):
        return "a list of one number"
    if len(shape) == 1:
        return f"{shape[0]} numbers" if isinstance(shape[0], int) else "a list of numbers"
    return f"an array of shape ({', '.join(map(str, shape))})"
