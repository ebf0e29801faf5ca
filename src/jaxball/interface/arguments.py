"""Arguments of the wrong kind, refused in a sentence: what was given, what it must be, the way out.

The checks look at types and shapes only, so that arguments may be traced.
"""

import inspect
import reprlib
import weakref
from collections.abc import Callable
from typing import Any, TypeGuard, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

Kind = TypeVar("Kind")

# Of each function that has been tried, the shapes of the arguments that it was tried with.
_seen: weakref.WeakKeyDictionary[Any, set[Any]] = weakref.WeakKeyDictionary()


def require(
    name: str, value: Any, kind: type[Kind] | tuple[type[Kind], ...], must: str, remedy: str = ""
) -> TypeGuard[Kind]:
    """Raises a ``TypeError`` unless the argument ``name`` is a ``kind``, in words: what it ``must`` be."""
    if isinstance(value, kind):
        return True
    raise refusal(name, must, value, remedy)


def require_each(name: str, values: Any, kind: type[Kind], must: str, remedy: str = "") -> None:
    """Raises a ``TypeError`` unless the argument ``name`` is a list or a tuple with nothing but ``kind`` in it."""
    if not isinstance(values, list | tuple):
        raise refusal(name, f"a list, each of it {must}", values, remedy)
    for index, value in enumerate(values):
        require(f"{name}[{index}]", value, kind, must, remedy)


def refusal(name: str, must: str, value: Any, remedy: str = "") -> TypeError:
    """The error for the argument ``name``, which ``must`` be something else than ``value``."""
    if isinstance(value, type) and not remedy:
        remedy = f"make one with {value.__name__}(...)"
    end = f"; {remedy}." if remedy else "."
    return TypeError(f"Argument `{name}` must be {must}, but it is {described(value)}{end}")


def described(value: Any) -> str:
    """What a value is, in a few words."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return reprlib.repr(value)
    if isinstance(value, list | tuple | dict | set):
        return f"the {type(value).__name__} {reprlib.repr(value)}"
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"an array of shape {value.shape} and type {value.dtype}"
    if inspect.isroutine(value):
        return f"the function {value.__name__}"
    return a(type(value).__name__)


def a(noun: str) -> str:
    """``noun`` with its article."""
    return f"{'an' if noun[:1] in 'AEIOUaeiou' else 'a'} {noun}"


def require_callable(name: str, function: Any, *takes: str) -> None:
    """Raises a ``TypeError`` unless the argument ``name`` is a function of as many arguments as it ``takes``."""
    signature = f"({', '.join(takes)})"
    if isinstance(function, type) or not callable(function):
        raise refusal(name, f"a function of {signature}", function)
    try:
        parameters = inspect.signature(function)
    except ValueError:  # some functions written in C do not say what they take
        return
    try:
        parameters.bind(*takes)
    except TypeError:
        raise TypeError(
            f"Argument `{name}` must be a function of {signature}, but {_named(function)} takes {parameters}."
        ) from None


def require_function(name: str, function: Any, shape: tuple[int, ...], **arguments: Any) -> None:
    """Raises a ``TypeError`` unless the argument ``name`` is a function whose value is an array of ``shape``.

    It is traced at ``arguments``, whose names are for the sentence only, and once for all arguments of these shapes. An
    error of its own goes through, with a note.
    """
    require_callable(name, function, *arguments)
    seen = _seen.setdefault(function, set()) if _can_be_kept(function) else set()
    leaves, structure = jax.tree.flatten(arguments)
    key = shape, structure, tuple((getattr(leaf, "shape", type(leaf)), getattr(leaf, "dtype", None)) for leaf in leaves)
    if key in seen:
        return
    try:
        value = eqx.filter_eval_shape(function, *arguments.values())
    except jax.errors.JAXTypeError as error:
        raise TypeError(
            f"Argument `{name}` must be a function that JAX can trace, written with jax.numpy and without branches on "
            f"the numbers that it is given, but {_named(function)} is not."
        ) from error
    except Exception as error:
        error.add_note(f"This came from argument `{name}`, when it was tried to see what shape its value has.")
        raise
    require_value(name, value, shape)
    seen.add(key)


def require_value(name: str, value: Any, shape: tuple[int, ...]) -> None:
    """Raises a ``TypeError`` unless ``value``, which a function gave, is an array of real numbers of ``shape``."""
    wanted = "a single number" if shape == () else f"an array of shape {shape}"
    if isinstance(value, jax.Array | np.ndarray | np.generic | jax.ShapeDtypeStruct):
        if value.shape == shape and jnp.issubdtype(value.dtype, jnp.floating):
            return
        found, remedy = described(value), ""
    elif isinstance(value, int | float) and shape == ():
        return
    elif isinstance(value, list | tuple):
        found, remedy = f"a {type(value).__name__} of length {len(value)}", "; join its parts with jnp.stack"
    else:
        found, remedy = described(value), ""
    raise TypeError(f"Argument `{name}` must give {wanted}, but it gives {found}{remedy}.")


def _can_be_kept(function: Any) -> bool:
    try:
        hash(function)
        weakref.ref(function)
    except TypeError:
        return False
    return True


def _named(function: Callable[..., Any]) -> str:
    name = getattr(function, "__name__", type(function).__name__)
    return "the lambda given" if name == "<lambda>" else name
