"""The types of elements, and elements themselves: numbers that are known, and names of those that are not yet.

An element is a scalar of NumPy, where it is known while compiling; the name of an instruction's result, ``%v12``; or,
of a complex type, a :class:`Pair` of such. An index is an ``int`` or a name. Names are strings, because they are mostly
written into instructions. Two kinds of them carry more than their text:

- A :class:`Vector` is one number for each lane. Where turns of a loop are computed side by side, it stands for the
  element of each turn.
- A :class:`Lane` is one number of a vector: elements of short arrays, which are computed in vectors.

Constant folding computes operations on known numbers, and knows identities that hold whatever the other number is.
"""

import functools
import operator
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from ..limits import LANES

Name: TypeAlias = str
Element: TypeAlias = Any
Index: TypeAlias = int | Name


class Vector(str):
    """The name of a vector: one number for each of ``width`` lanes."""

    width: int

    def __new__(cls, name: str, width: int = LANES) -> "Vector":
        """Makes the name of a vector of a name."""
        new = super().__new__(cls, name)
        new.width = width
        return new


class Lane(str):
    """The name of one number of a ``vector``: ``%v7.2``, at ``position`` 2 in ``%v7``."""

    vector: Vector
    position: int

    def __new__(cls, vector: Vector, position: int) -> "Lane":
        """Makes the name of a lane."""
        new = super().__new__(cls, f"{vector}.{position}")
        new.vector, new.position = vector, position
        return new


class UnsupportedError(Exception):
    """An unsupported feature, named so that "… is not compiled natively" is a sentence."""


class Pair:
    """A complex number."""

    __slots__ = ("imag", "real")

    def __init__(self, real: Element, imag: Element):
        self.real, self.imag = real, imag


_DTYPES = {"f64": "float64", "f32": "float32", "i1": "bool", "complex<f64>": "complex128", "complex<f32>": "complex64"}
_DTYPES |= {f"i{bits}": f"int{bits}" for bits in (8, 16, 32, 64)}
_DTYPES |= {f"ui{bits}": f"uint{bits}" for bits in (8, 16, 32, 64)}
_NAMED = {name: np.dtype(dtype) for name, dtype in _DTYPES.items()}


def dtype_named(name: str) -> np.dtype:
    """Returns the dtype of an element type of StableHLO."""
    if name not in _NAMED:
        raise UnsupportedError(f"An array of {name}")
    return _NAMED[name]


def llvm_type(dtype: np.dtype) -> str:
    """Returns LLVM's type of a number in a register: complex ones have none, their parts do."""
    if dtype.kind == "f":
        return "double" if dtype.itemsize == 8 else "float"
    return "i1" if dtype.kind == "b" else f"i{8 * dtype.itemsize}"


def suffix_of(dtype: np.dtype) -> str:
    """Returns a type as intrinsics' names have it."""
    return f"{'f' if dtype.kind == 'f' else 'i'}{1 if dtype.kind == 'b' else 8 * dtype.itemsize}"


@functools.cache
def vector_type(dtype: np.dtype, width: int = LANES) -> str:
    """Returns LLVM's type of one number for each lane; of a single number where there is none."""
    return f"<{width} x {llvm_type(dtype)}>" if width else llvm_type(dtype)


def width_of(*elements: Element) -> int:
    """Returns how many lanes the vectors among the elements have; 0 where none is a vector."""
    for element in elements:
        if isinstance(element, Vector):
            return element.width
    return 0


def part_of(dtype: np.dtype) -> np.dtype:
    """Returns the type of a complex type's parts; any other as it is."""
    return np.dtype(f"f{dtype.itemsize // 2}") if dtype.kind == "c" else dtype


def in_lanes(*elements: Element) -> bool:
    """Returns whether any of the elements has one number for each lane."""
    for element in elements:
        if isinstance(element, Vector) or (isinstance(element, Pair) and in_lanes(element.real, element.imag)):
            return True
    return False


def is_known(element: Element) -> bool:
    """Returns whether an element's number is known while compiling."""
    if isinstance(element, str):
        return False
    return not isinstance(element, Pair) or (is_known(element.real) and is_known(element.imag))


def write_element(element: Element) -> str:
    """Formats a number as LLVM writes it; a name as it is."""
    if isinstance(element, str):
        return element
    if isinstance(element, np.bool_ | bool):
        return "true" if element else "false"
    if isinstance(element, np.floating | float):  # LLVM writes also those of 32 bits by the 64 of the same number
        return f"0x{np.float64(element).view(np.uint64):016X}"
    return str(int(element))


def read_element(dtype: np.dtype, number: str) -> Element:
    """Reads a number as LLVM writes it."""
    if dtype.kind == "b":
        return np.bool_(number == "true")
    if dtype.kind == "f":
        return dtype.type(np.uint64(int(number, 16)).view(np.float64))
    return np.array(int(number)).astype(dtype)[()]


def as_elements(numbers: np.ndarray) -> np.ndarray:
    """Converts an array of numbers to an array of elements."""
    elements = np.empty(numbers.shape, object)
    # One by one: NumPy would make Python's numbers of them, which have no type.
    flat = elements.reshape(-1)
    for position, number in enumerate(numbers.reshape(-1)):
        flat[position] = Pair(number.real, number.imag) if numbers.dtype.kind == "c" else number
    return elements


FOLDED: dict[str, Callable[[Any, Any], Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "and": operator.and_,
    "or": operator.or_,
    "xor": operator.xor,
}
# Numbers that are known have a type, so that the same operator compares signed and unsigned ones.
COMPARED: dict[str, Callable[[Any, Any], Any]] = {
    "eq": operator.eq,
    "ne": operator.ne,
    "slt": operator.lt,
    "sle": operator.le,
    "sgt": operator.gt,
    "sge": operator.ge,
    "ult": operator.lt,
    "ule": operator.le,
    "ugt": operator.gt,
    "uge": operator.ge,
    "oeq": operator.eq,
    "une": operator.ne,
    "olt": operator.lt,
    "ole": operator.le,
    "ogt": operator.gt,
    "oge": operator.ge,
}


def simpler_float(operation: str, x: Element, y: Element) -> Element | None:
    """Returns the operand that equals the result whatever the other number is: also for −0, infinities and NaN."""
    # Not x + 0, which is 0 where x is −0, and not 0 x, which is −0 of a negative number, and NaN of an infinite one.
    if operation in ("mul", "div") and is_known(y) and y == 1:
        return x
    if operation == "mul" and is_known(x) and x == 1:
        return y
    if operation == "sub" and is_known(y) and y == 0 and not np.signbit(y):
        return x
    if operation == "add":
        for number, other in ((x, y), (y, x)):
            if is_known(number) and number == 0 and np.signbit(number):
                return other
    return None


def in_order(x: Element, y: Element) -> tuple[Element, Element]:
    """Returns two operands in one order, whichever comes first, so that x y and y x are found to be the same."""
    return (y, x) if isinstance(x, str) and isinstance(y, str) and y < x else (x, y)


def simpler_integer(operation: str, dtype: np.dtype, x: Element, y: Element) -> Element | None:
    for number, other in ((y, x), (x, y)):
        # 0 − y is not y.
        if not is_known(number) or (operation == "sub" and number is x):
            continue
        if number == 0 and operation in ("add", "sub", "or", "xor"):
            return other
        if number == 0 and operation in ("mul", "and"):
            return dtype.type(0)
        if operation == "mul" and number == 1:
            return other
        if dtype.kind == "b" and number and operation in ("and", "or"):
            return other if operation == "and" else np.bool_(True)
    if operation in ("and", "or") and isinstance(x, str) and x == y:
        return x
    return None
