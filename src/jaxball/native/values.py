"""Where the numbers of an array are: in registers, in memory, or nowhere, because they follow from an index.

- Small arrays are :class:`Registers`: an array of NumPy of elements, so that to slice or to transpose costs nothing.
- Larger ones lie in :class:`Memory`, row by row.
- A :class:`Formula` gives the element of an index when it is asked, so that a chain of operations becomes one loop.

All have ``shape``, ``dtype`` and ``element(builder, index)``.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np

from .builder import Builder
from .elements import Element, Index, Name, Pair, as_elements, llvm_type, part_of, written

MOST_REGISTERS = 64  # numbers of an array
_DEEPEST = 40  # formulas in formulas


class Buffer:
    """Memory of an array.

    - ``owners``: how many values are there, or follow from what is there.
    - ``writable``: whether it is the program's, neither an argument nor a constant.
    - ``size``: its bytes, which are used again once nobody owns it; 0 where they are not.
    - ``pinned``: how many loops and branches that are being written need it, whoever owns it.
    """

    __slots__ = ("name", "owners", "pinned", "size", "writable")

    def __init__(self, name: Name, size: int, writable: bool = True):
        self.name, self.size, self.writable = name, size, writable
        self.owners, self.pinned = 0, 0


class Registers:
    """An array whose ``elements`` are an array of NumPy: of numbers, or of objects, see :mod:`elements`."""

    buffers: tuple[Buffer, ...] = ()

    def __init__(self, dtype: np.dtype, elements: np.ndarray):
        self.dtype, self.elements = dtype, elements
        self.shape = elements.shape

    @property
    def known(self) -> bool:
        """Whether all numbers are known."""
        return self.elements.dtype != object

    def objects(self) -> np.ndarray:
        """The elements, those that are known as scalars."""
        return as_elements(self.elements) if self.known else self.elements

    def element(self, builder: Builder, index: Sequence[Index]) -> Element:
        """The element at an index, which must be known in dimensions longer than one."""
        position: Any = tuple(0 if length == 1 else i for i, length in zip(index, self.shape, strict=True))
        element: Any = self.elements[position]
        return Pair(element.real, element.imag) if self.known and self.dtype.kind == "c" else element

    def has(self, index: Sequence[Index]) -> bool:
        """Whether such an index says which element."""
        return all(isinstance(i, int) or length == 1 for i, length in zip(index, self.shape, strict=True))


class Memory:
    """An array in a buffer."""

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype, buffer: Buffer):
        self.shape, self.dtype, self.buffer = shape, dtype, buffer
        self.buffers = (buffer,)

    def element(self, builder: Builder, index: Sequence[Index]) -> Element:
        return load(builder, self.dtype, self.address(builder, index))

    def address(self, builder: Builder, index: Sequence[Index]) -> Name:
        """Where the element of an index is."""
        offset = builder.times(linear(builder, self.shape, index), self.dtype.itemsize)
        return builder.address(self.buffer.name, offset)


class Formula:
    """An array that has no numbers yet: ``at(index)`` writes what computes one.

    ``cheap``: it only moves what lies in ``buffers``, and may as well be computed twice.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        dtype: np.dtype,
        at: Callable[[Sequence[Index]], Element],
        of: Sequence["Array"],
        cheap: bool = False,
    ):
        self.shape, self.dtype, self.at = shape, dtype, at
        self.buffers = tuple({id(buffer): buffer for array in of for buffer in array.buffers}.values())
        self.depth = 1 + max((array.depth for array in of if isinstance(array, Formula)), default=0)
        self.cheap = cheap and all(not isinstance(array, Formula) or array.cheap for array in of)

    @property
    def deep(self) -> bool:
        return self.depth > _DEEPEST

    def element(self, builder: Builder, index: Sequence[Index]) -> Element:
        return self.at(index)


Array: TypeAlias = Registers | Memory | Formula


def registers(dtype: np.dtype, elements: Sequence[Element], shape: tuple[int, ...]) -> Registers:
    """Registers of elements in the order of their places, row by row."""
    array = np.empty(len(elements), object)
    for position, element in enumerate(elements):
        array[position] = element
    return Registers(dtype, array.reshape(shape))


def size_of(shape: Sequence[int]) -> int:
    return math.prod(shape)


def is_small(shape: Sequence[int]) -> bool:
    """Whether an array of that shape is kept in registers."""
    return size_of(shape) <= MOST_REGISTERS


def linear(builder: Builder, shape: Sequence[int], index: Sequence[Index]) -> Index:
    """The position of an index, row by row."""
    position: Index = 0
    for i, length in zip(index, shape, strict=True):
        position = builder.plus(builder.times(position, length), 0 if length == 1 else i)
    return position


def unravelled(builder: Builder, shape: Sequence[int], position: Index) -> list[Index]:
    """The index of a position, row by row."""
    if isinstance(position, int):
        return [int(i) for i in np.unravel_index(position, shape)] if shape else []
    index: list[Index] = []
    for length in reversed(shape[1:]):
        if length == 1:
            index.append(0)
            continue
        index.append(builder.pure(f"urem i64 {position}, {length}"))
        position = builder.pure(f"udiv i64 {position}, {length}")
    return [*([position] if shape else []), *index[::-1]]


def load(builder: Builder, dtype: np.dtype, address: Name) -> Element:
    """The number at an address; a boolean is a byte."""
    if dtype.kind == "c":
        part = part_of(dtype)
        return Pair(load(builder, part, address), load(builder, part, builder.address(address, part.itemsize)))
    if dtype.kind == "b":
        return builder.effect(f"icmp ne i8 {builder.effect(f'load i8, ptr {address}')}, 0")
    return builder.effect(f"load {llvm_type(dtype)}, ptr {address}")


def store(builder: Builder, dtype: np.dtype, element: Element, address: Name) -> None:
    """Writes a number to an address."""
    if dtype.kind == "c":
        part = part_of(dtype)
        store(builder, part, element.real, address)
        store(builder, part, element.imag, builder.address(address, part.itemsize))
    elif dtype.kind == "b":
        byte = str(int(element)) if not isinstance(element, str) else builder.pure(f"zext i1 {element} to i8")
        builder.write(f"store i8 {byte}, ptr {address}")
    else:
        builder.write(f"store {llvm_type(dtype)} {written(element)}, ptr {address}")


def indices(shape: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """All indices, row by row."""
    return iter(np.ndindex(*shape))
