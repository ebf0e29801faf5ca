"""How the values in the trace of a function depend on time: not at all, piece by piece linearly, or otherwise.

``time_comparisons`` keeps this for each value while it goes through a trace.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..interface.compat import function_of

MOST_PIECES = 16

Lazy = Callable[[], Any]

# Operations that are linear in what they are given, all of it or its first operand; indices come after that.
OF_ALL = ("concatenate", "stack")
OF_FIRST = ("broadcast_in_dim", "copy", "cumsum", "expand_dims", "neg", "reduce_precision", "reduce_sum", "reshape")
OF_FIRST += ("rev", "slice", "squeeze", "transpose")
ROUNDING_OPERATIONS = (
    "add",
    "add_any",
    "sub",
    "mul",
    "div",
    "cumsum",
    "reduce_sum",
    "reduce_precision",
    "convert_element_type",
)
BY_INDEX = ("dynamic_slice", "gather")


class Fixed(NamedTuple):
    """A value that depends on nothing but parameters, computed when it is asked for.

    - ``known``: its number, where that is written in the function.
    - ``positive``: whether it is never negative, whatever the parameters.
    """

    value: Lazy
    known: float | None = None
    positive: bool = False


class Piece(NamedTuple):
    """slope · t + offset, each of the shape of the value; without a slope, a constant.

    - ``evaluate``: the value at a time, rounded as the function rounds it.
    - ``exact``: whether that is a constant, the time or its negative, without any rounding.
    """

    slope: Lazy | None
    offset: Lazy
    evaluate: Callable[[Array], Array]
    exact: bool

    @classmethod
    def constant(cls, value: Lazy) -> "Piece":
        return cls(None, value, lambda t: value(), True)

    def transform(self, transform: Callable[[Array], Array]) -> "Piece":
        """Applies a linear transformation without rounding to the piece."""
        slope = self.slope
        return Piece(
            None if slope is None else lambda: transform(slope()),
            lambda: transform(self.offset()),
            lambda t: transform(self.evaluate(t)),
            self.exact,
        )


class Dependent(NamedTuple):
    """A value of which no more is known than what it depends on.

    - ``time``: whether it varies with time between the times that have been taken.
    - ``state``: whether it depends on the state.
    - ``positive``: whether it is never negative.
    """

    time: bool
    state: bool
    positive: bool = False


class Piecewise(NamedTuple):
    """A value that is one of several linear functions of time; from one to another it changes at times taken."""

    pieces: tuple[Piece, ...]

    @classmethod
    def of(cls, pieces: tuple[Piece, ...]) -> "Value":
        if len(pieces) <= MOST_PIECES:
            return cls(pieces)
        return Dependent(any(piece.slope is not None for piece in pieces), False)

    def to_each(self) -> "Piecewise":
        """Returns the same value with an axis of length 1 after its own, to be compared with each row of a table."""
        return Piecewise(tuple(piece.transform(lambda x: x[..., None]) for piece in self.pieces))


Value = Fixed | Piecewise | Dependent


def fix_value(value: Any) -> Fixed:
    """Returns a value as one that does not change with time."""
    return Fixed(lambda: value)


def read_literal(literal: Any) -> Fixed:
    """Reads a number that is written in the function."""
    value = np.asarray(literal.val, literal.aval.dtype)
    number = float(value) if value.ndim == 0 and np.isrealobj(value) else None
    return Fixed(lambda: value, number, number is not None and number >= 0)


def pieces_of(value: Value) -> tuple[Piece, ...]:
    """Returns the pieces of a value, one constant piece for a fixed one."""
    if isinstance(value, Piecewise):
        return value.pieces
    assert isinstance(value, Fixed)
    return (Piece.constant(value.value),)


def join_dependences(values: Sequence[Value]) -> Dependent:
    """Returns whether a function of several values depends on time, and whether on the state."""
    each = [_dependence(value) for value in values]
    return Dependent(any(value.time for value in each), any(value.state for value in each))


def _dependence(value: Value) -> Dependent:
    if isinstance(value, Dependent):
        return value
    return Dependent(any(piece.slope is not None for piece in pieces_of(value)), False)


def is_linear(name: str, equation: Any, given: Sequence[Value]) -> bool:
    """Returns whether an operation on linear pieces gives linear pieces, and not too many of them."""
    if not all(isinstance(value, Fixed | Piecewise) for value in given):
        return False
    count = 1
    for value in given:
        count *= len(pieces_of(value))
    if count > MOST_PIECES:
        return False
    if name in OF_ALL or name in OF_FIRST or name in ROUNDING_OPERATIONS[:3]:
        return True
    if name in BY_INDEX:
        return all(isinstance(value, Fixed) for value in given[1:])
    if name == "convert_element_type":
        return all(jnp.issubdtype(of.aval.dtype, jnp.floating) for of in (equation.invars[0], equation.outvars[0]))
    if name == "div":
        return isinstance(given[1], Fixed)
    return name == "mul" and any(all(piece.slope is None for piece in pieces_of(value)) for value in given)


def through(equation: Any, given: Sequence[Value]) -> Piecewise:
    """Returns the pieces of the result of a linear operation."""
    name = equation.primitive.name
    return Piecewise(tuple(_piece(name, equation, each) for each in itertools.product(*map(pieces_of, given))))


def _piece(name: str, equation: Any, pieces: tuple[Piece, ...]) -> Piece:
    operation = function_of(equation)

    @functools.cache
    def offset() -> Array:
        return operation(*(piece.offset() for piece in pieces))

    def evaluate(t: Array) -> Array:
        return operation(*(piece.evaluate(t) for piece in pieces))

    exact = name not in ROUNDING_OPERATIONS and all(piece.exact for piece in pieces)
    if all(piece.slope is None for piece in pieces):
        return Piece(None, offset, evaluate, True)

    @functools.cache
    def slope() -> Array:
        first, *others = pieces
        if name == "mul":
            return operation(*(_slope(piece) if piece.slope is not None else piece.offset() for piece in pieces))
        if name == "div" or name in BY_INDEX:
            return operation(_slope(first), *(piece.offset() for piece in others))
        return operation(*map(_slope, pieces))

    return Piece(slope, offset, evaluate, exact)


def _slope(piece: Piece) -> Array:
    return jnp.zeros_like(piece.offset()) if piece.slope is None else piece.slope()
