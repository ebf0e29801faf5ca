"""Takes captured arrays out of users' functions before a computation, and puts them back where it is traced.

A law or the function of an event may use arrays that are traced where it is written, such as a gain that is mapped or
differentiated. JAX's rules for derivatives take a function as a constant, and would give the derivative zero. So before
a computation, such arrays are taken out of the functions among its arguments, and put back where it is traced. A
function that is written within another is a new object at each call of the outer one. Here two of them are equal if
their code and what they hold are.
"""

import functools
import types
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...interface.compat import is_traced
from .code import codes_in
from .names import home_of, is_known

T = TypeVar("T")


class _Place(NamedTuple):
    """Stands in a function for an array that it had captured."""

    number: int


class OpenFunction:
    """A function, in which places stand for captured arrays that may have derivatives.

    Two are equal if they have the same code and all that this uses is the same and cannot change: numbers, texts,
    arrays of JAX, parts of known libraries, and functions of that kind. So a ``lambda`` that is written anew is known
    again, and one that uses a variable of a module, an object or a list, which may have changed, is only equal to
    itself.

    - ``function``: with cells of its own, so that what is assigned to a variable later is not seen.
    - ``original``: what the user wrote.
    """

    follows = "original", "_key"  # what does not determine what it computes

    def __init__(self, function: types.FunctionType, original: types.FunctionType):
        self.function, self.original = function, original
        self.__name__ = function.__name__
        held = [cell.cell_contents if _is_filled(cell) else _UNKNOWN for cell in function.__closure__ or ()]
        held += [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).items(), *_find_used(function)]
        held += [_UNKNOWN] if vars(function) else []
        described = tuple(map(_description, held))
        identity = _Itself(id(original)) if _UNKNOWN in described else None
        self._key = function.__code__, id(function.__globals__), described, identity

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OpenFunction) and self._key == other._key


class _Itself(NamedTuple):
    """Stands for an object that is only equal to itself; who has it holds the object, so that it stays."""

    identity: int


_UNKNOWN = "unknown"  # described as itself, where a text is described with its type


def _description(value: Any) -> Any:
    """Returns a description that is the same only for values that are the same and cannot change; ``_UNKNOWN`` for
    values that may.
    """
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | np.generic):
        # As text, by which 1, 1.0 and True differ, and 0.0 and -0.0.
        return _UNKNOWN if value is _UNKNOWN else (type(value), repr(value))
    if isinstance(value, tuple):
        parts = tuple(map(_description, value))
        return _UNKNOWN if _UNKNOWN in parts else (type(value), parts)
    if isinstance(value, OpenFunction):
        return value
    is_fixed = isinstance(value, jax.Array) and not is_traced(value)
    return _Itself(id(value)) if is_fixed or _is_of_known_library(value) else _UNKNOWN


def _is_of_known_library(value: Any) -> bool:
    if isinstance(value, types.ModuleType):
        return is_known(value.__name__)
    return isinstance(value, types.FunctionType | types.BuiltinFunctionType | type) and home_of(value) is not None


def _find_used(function: types.FunctionType) -> list[Any]:
    """Returns the values of global names that a function uses."""
    names = {name for code in codes_in(function.__code__) for name in code.co_names}
    return [function.__globals__[name] for name in sorted(names & function.__globals__.keys())]


def take_captures(tree: T, local: bool = False) -> tuple[T, list[Any]]:
    """Takes out of the functions in a PyTree the arrays that may have derivatives, and returns both.

    These functions become open ones. Where there are none, the PyTree is returned itself.

    - ``local``: whether all functions that are written within others become open ones.
    """
    captures: list[Any] = []

    def take(array: Any) -> _Place:
        captures.append(array)
        return _Place(len(captures) - 1)

    def open_function(function: types.FunctionType) -> Any:
        template = change.contents(function)
        if template is function and local and "<locals>" in function.__qualname__:
            template = change.contents(function, always=True)
        return function if template is function else OpenFunction(template, function)

    change = _Change(types.FunctionType, open_function, _may_have_derivatives, take)
    return change(tree), captures


def put_captures(tree: T, captures: list[Any]) -> T:
    """Puts arrays into the functions from which :func:`take_captures` took those before."""

    def close_function(opened: OpenFunction) -> types.FunctionType:
        return change.contents(opened.function)

    def is_place(value: Any) -> bool:
        return isinstance(value, _Place)

    change = _Change(OpenFunction, close_function, is_place, lambda place: captures[place.number])
    return change(tree)


def change_with_captures(change: Callable[[Any], Any], tree: T) -> T:
    """Makes a change to the leaves of a PyTree and to what its functions have captured."""
    return put_captures(*change(take_captures(tree)))


def _may_have_derivatives(value: Any) -> bool:
    return is_traced(value) and jnp.issubdtype(value.dtype, jnp.inexact)


class _Change:
    """Makes a change to the functions of one kind in a PyTree, and to what they hold.

    - ``function``: changes a function of the ``kind``.
    - ``array``: changes an array that a function holds, where ``is_array`` says yes.
    """

    def __init__(self, kind: type, function: Callable, is_array: Callable[[Any], bool], array: Callable):
        self.kind, self.function, self.is_array, self.array = kind, function, is_array, array
        self._entered: set[int] = set()

    def __call__(self, value: Any, held: bool = False) -> Any:
        """Returns the value itself where nothing in it changes."""
        if isinstance(value, self.kind):
            return self._once(value)
        if held and self.is_array(value):
            return self.array(value)
        change = functools.partial(self, held=held)
        if isinstance(value, functools.partial):
            parts = [value.func, *value.args], value.keywords
            new, words = change(parts[0]), change(parts[1])
            is_same = new is parts[0] and words is parts[1]
            return value if is_same else type(value)(*new, **words)
        if isinstance(value, types.MethodType):
            owner = change(value.__self__)
            return value if owner is value.__self__ else types.MethodType(value.__func__, owner)
        if isinstance(value, dict):
            items = _change_each(value.values(), change)
            return value if items is None else type(value)(zip(value, items, strict=True))
        if held and isinstance(value, list):  # in which a function may note what it was called with
            return value
        if isinstance(value, tuple | list):
            items = _change_each(value, change)
            if items is None:
                return value
            return type(value)(*items) if hasattr(value, "_fields") else type(value)(items)
        if isinstance(value, eqx.Module):
            return self._module(value, change)
        return value

    def _module(self, value: eqx.Module, change: Callable) -> eqx.Module:
        fields = _change_each(vars(value).values(), change)
        if fields is None:
            return value
        new = object.__new__(type(value))
        for name, field in zip(vars(value), fields, strict=True):
            object.__setattr__(new, name, field)
        return new

    def _once(self, function: Any) -> Any:
        if id(function) in self._entered:  # a function that calls itself
            return function
        self._entered.add(id(function))
        try:
            return self.function(function)
        finally:
            self._entered.discard(id(function))

    def contents(self, function: types.FunctionType, always: bool = False) -> types.FunctionType:
        """Makes the change to what a function has captured, and to its defaults, in a copy of it.

        - ``always``: whether there is a copy even if nothing changes.
        """
        cells = function.__closure__ or ()
        captured = tuple(cell.cell_contents for cell in cells if _is_filled(cell))
        held = [captured, function.__defaults__, function.__kwdefaults__]
        contents, defaults, words = new = [self(value, held=True) for value in held]
        if not always and all(entry is other for entry, other in zip(new, held, strict=True)):
            return function
        remaining = iter(contents)
        closure = tuple(types.CellType(next(remaining)) if _is_filled(cell) else cell for cell in cells)
        clone = types.FunctionType(function.__code__, function.__globals__, function.__name__, defaults, closure)
        clone.__kwdefaults__, clone.__qualname__ = words, function.__qualname__
        clone.__dict__.update(vars(function))
        return clone


def _change_each(values: Iterable[Any], change: Callable) -> list[Any] | None:
    """Returns the values after a change; None if it changes nothing."""
    old = list(values)
    new = list(map(change, old))
    return None if all(value is other for value, other in zip(new, old, strict=True)) else new


def _is_filled(cell: types.CellType) -> bool:
    try:
        return cell.cell_contents is not cell
    except ValueError:  # what is assigned later
        return False
