"""The types of elements, and elements themselves: numbers that are known, and names of those that are not yet.

An element is a scalar of NumPy, where it is known while compiling; the name of an instruction's result, ``%12``; or,
of a complex type, a :class:`Pair` of such. An index is an ``int`` or a name. Where turns of a loop are computed side by
side, a name of :class:`Lanes` stands for one number of each.
"""

import functools
import re
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

Name: TypeAlias = str
Element: TypeAlias = Any
Index: TypeAlias = int | Name

_LANE = re.compile(r"(%v\d+)\.(\d)")

LANES = 8
FEWEST_ALWAYS = 5  # elements of a first axis that are computed in vectors whatever it costs to make these
MOST_ROWS = 2 * LANES  # of a first axis that is computed in vectors: with more than eight, in two


class Lanes(str):
    """The name of a vector: one number for each of ``width`` lanes."""

    width: int

    def __new__(cls, name: str, width: int = LANES) -> "Lanes":
        """The name as one of a vector."""
        new = super().__new__(cls, name)
        new.width = width
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
    """The dtype of an element type of StableHLO."""
    if name not in _NAMED:
        raise UnsupportedError(f"An array of {name}")
    return _NAMED[name]


def llvm_type(dtype: np.dtype) -> str:
    """LLVM's type of a number in a register: complex ones have none, their parts do."""
    if dtype.kind == "f":
        return "double" if dtype.itemsize == 8 else "float"
    return "i1" if dtype.kind == "b" else f"i{8 * dtype.itemsize}"


@functools.cache
def vector_type(dtype: np.dtype, width: int = LANES) -> str:
    """LLVM's type of one number for each lane; of a single number where there is none."""
    return f"<{width} x {llvm_type(dtype)}>" if width else llvm_type(dtype)


def width_of(*elements: Element) -> int:
    """How many lanes those of the elements have that are vectors; 0 where none is."""
    for element in elements:
        if isinstance(element, Lanes):
            return element.width
    return 0


def part_of(dtype: np.dtype) -> np.dtype:
    """The type of a complex type's parts; any other as it is."""
    return np.dtype(f"f{dtype.itemsize // 2}") if dtype.kind == "c" else dtype


def in_lanes(*elements: Element) -> bool:
    """Whether any of the elements has one number for each lane."""
    for element in elements:
        if isinstance(element, Lanes) or (isinstance(element, Pair) and in_lanes(element.real, element.imag)):
            return True
    return False


def is_known(element: Element) -> bool:
    """Whether an element's number is known while compiling."""
    if isinstance(element, str):
        return False
    return not isinstance(element, Pair) or (is_known(element.real) and is_known(element.imag))


def write_element(element: Element) -> str:
    """A number as LLVM writes it; a name as it is."""
    if isinstance(element, str):
        return element
    if isinstance(element, np.bool_ | bool):
        return "true" if element else "false"
    if isinstance(element, np.floating):  # LLVM writes also those of 32 bits by the 64 of the same number
        return f"0x{np.float64(element).view(np.uint64):016X}"
    return str(int(element))


def as_elements(numbers: np.ndarray) -> np.ndarray:
    """An array of elements of an array of numbers."""
    elements = np.empty(numbers.shape, object)
    flat = elements.reshape(-1)
    for position, number in enumerate(numbers.reshape(-1)):
        flat[position] = Pair(number.real, number.imag) if numbers.dtype.kind == "c" else number
    return elements


def with_lanes(text: str, vectors: Mapping[Name, tuple[np.dtype, int]]) -> list[str]:
    """The lines of a function, with the lanes that it reads taken out of their vectors where these are made.

    - ``vectors``: type and width of those whose lanes have names.
    """
    read: dict[Name, list[str]] = {}
    for vector, lane in sorted(set(_LANE.findall(text)), key=lambda pair: int(pair[1])):
        read.setdefault(vector, []).append(lane)
    lines, waiting = [], []  # behind the last phi of a block
    for line in text.split("\n"):
        vector, _, instruction = line.partition(" = ")
        is_phi = instruction.startswith("phi ")
        if not is_phi:
            lines += waiting
            waiting = []
        lines.append(line)
        for lane in read.get(vector, ()) if vector in vectors else ():
            kind = vector_type(*vectors[vector])
            taken = f"{vector}.{lane} = extractelement {kind} {vector}, i64 {lane}"
            (waiting if is_phi else lines).append(taken)
    return lines
