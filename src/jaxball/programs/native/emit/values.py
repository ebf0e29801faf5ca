"""Where the numbers of an array are: in registers, in memory, or nowhere, if they are a formula of the index.

- Small arrays are :class:`Registers`: an array of NumPy of elements, so that to slice or to transpose costs nothing.
- Larger ones lie in :class:`Memory`, row by row.
- A :class:`Formula` gives the element of an index when it is asked, so that a chain of operations becomes one loop.

All have ``shape``, ``dtype``, ``varying``, whether an element is a vector with one number for each lane, and
``element(builder, index)``.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np

from ..ir.elements import (
    Element,
    Index,
    Name,
    Pair,
    UnsupportedError,
    Vector,
    as_elements,
    in_lanes,
    llvm_type,
    part_of,
    vector_type,
)
from ..limits import (
    DEEPEST_FORMULA,
    FEWEST_ALWAYS,
    LANES,
    LONGEST_AXIS,
    MOST_PAIRS,
    MOST_REGISTERS,
    MOST_ROWS,
    MOST_VECTORS,
)
from .buffers import Buffer
from .builder import INDEX, Builder
from .instructions import BOOL


class Registers:
    """An array whose ``elements`` are an array of NumPy: of numbers, or of objects, see :mod:`elements`.

    ``twin``: the same numbers in memory, where they are there as well.
    """

    buffers: tuple[Buffer, ...] = ()
    twin: "Memory | None" = None

    def __init__(self, dtype: np.dtype, elements: np.ndarray):
        self.dtype, self.elements = dtype, elements
        self.shape = elements.shape

    @property
    def varying(self) -> bool:
        return not self.known and in_lanes(*self.elements.reshape(-1))

    @property
    def known(self) -> bool:
        """Whether all numbers are known."""
        return self.elements.dtype != object

    def objects(self) -> np.ndarray:
        """Returns the elements, the known ones as scalars."""
        return as_elements(self.elements) if self.known else self.elements

    def flat(self) -> list[Element]:
        """Lists the elements, row by row."""
        if self.known and self.dtype.kind != "c":
            return list(self.elements.reshape(-1))
        return self.objects().reshape(-1).tolist()

    def element(self, builder: Builder, index: Sequence[Index]) -> Element:
        """Returns the element at an index, which must be known in dimensions longer than one."""
        # An index along a dimension of length one may be unknown, and is 0 all the same.
        position: Any = tuple(0 if length == 1 else i for i, length in zip(index, self.shape, strict=True))
        element: Any = self.elements[position]
        return Pair(element.real, element.imag) if self.known and self.dtype.kind == "c" else element

    def has(self, index: Sequence[Index]) -> bool:
        """Returns whether such an index says which element."""
        return all(isinstance(i, int) or length == 1 for i, length in zip(index, self.shape, strict=True))


class Memory:
    """An array in a buffer."""

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype, buffer: Buffer):
        self.shape, self.dtype, self.buffer = shape, dtype, buffer
        self.buffers = (buffer,)

    @property
    def varying(self) -> bool:
        return self.buffer.lanes

    def element(self, builder: Builder, index: Sequence[Index]) -> Element:
        place = linear(builder, self.shape, index)
        if not isinstance(place, Vector):
            return load(builder, self.dtype, self._parts(builder, place), self.buffer.lanes)
        # Each lane reads at a place of its own.
        rows = [load(builder, self.dtype, self._of_lane(builder, place, lane)) for lane in range(LANES)]
        if self.dtype.kind != "c":
            return builder.gather(self.dtype, rows)
        part = part_of(self.dtype)
        return Pair(*(builder.gather(part, [getattr(row, name) for row in rows]) for name in ("real", "imag")))

    def put(self, builder: Builder, index: Sequence[Index], element: Element) -> None:
        """Writes the element of an index, where there is a mask and the array is from before it in its lanes."""
        place = linear(builder, self.shape, index)
        # Memory that was allocated under the mask holds nothing that lanes outside of it would still read.
        mask = builder.mask if self.buffer.level < builder.level else None
        if not isinstance(place, Vector):
            # One place would be written by several lanes. Which of them was last, no program may depend on.
            if not self.buffer.lanes and (in_lanes(element) or mask is not None):
                raise UnsupportedError("An array that becomes one of each lane")
            store(builder, self.dtype, element, self._parts(builder, place), self.buffer.lanes, mask)
            return
        if not self.buffer.lanes and not self.buffer.shared:
            raise UnsupportedError("An array that becomes one of each lane")
        for lane in range(LANES):
            lane_mask = None if mask is None else builder.lane(BOOL, mask, lane)
            number = lane_of(builder, self.dtype, element, lane)
            store(builder, self.dtype, number, self._of_lane(builder, place, lane), False, lane_mask)

    def _parts(self, builder: Builder, place: Index) -> list[Name]:
        """Returns where the number at a place is, or the two parts of a complex one."""
        size = part_of(self.dtype).itemsize * (LANES if self.buffer.lanes else 1)
        count = self.dtype.itemsize // part_of(self.dtype).itemsize
        first = builder.address(self.buffer.name, builder.times(place, count * size))
        return [builder.address(first, part * size) for part in range(count)]

    def _of_lane(self, builder: Builder, places: Vector, lane: int) -> list[Name]:
        """Returns where one lane's number at its own place is, or its parts."""
        offset = lane * part_of(self.dtype).itemsize if self.buffer.lanes else 0
        places_of = self._parts(builder, builder.lane(INDEX, places, lane))
        return [builder.address(part, offset) for part in places_of]


class Formula:
    """An array that has no numbers yet: ``at(index)`` writes what computes one.

    ``cheap``: it only moves what lies in ``buffers``, and may as well be computed twice. ``varying``: its elements are
    vectors whatever it is made ``of``.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        dtype: np.dtype,
        at: Callable[[Sequence[Index]], Element],
        of: Sequence["Array"],
        cheap: bool = False,
        varying: bool = False,
    ):
        self.shape, self.dtype, self.at = shape, dtype, at
        self.buffers = tuple({id(buffer): buffer for array in of for buffer in array.buffers}.values())
        self.depth = 1 + max((array.depth for array in of if isinstance(array, Formula)), default=0)
        self.varying = varying or any(array.varying for array in of)
        self.cheap = cheap and all(not isinstance(array, Formula) or array.cheap for array in of)

    @property
    def deep(self) -> bool:
        return self.depth > DEEPEST_FORMULA

    def element(self, builder: Builder, index: Sequence[Index]) -> Element:
        return self.at(index)


Array: TypeAlias = Registers | Memory | Formula


def registers(dtype: np.dtype, elements: Sequence[Element], shape: tuple[int, ...]) -> Registers:
    """Registers of elements in the order of their places, row by row."""
    return Registers(dtype, np.fromiter(elements, object, len(elements)).reshape(shape))


def size_of(shape: Sequence[int]) -> int:
    return math.prod(shape)


def is_small(shape: Sequence[int]) -> bool:
    """Returns whether an array of that shape is kept in registers."""
    size = size_of(shape)
    # A first axis in vectors divides the number of registers by its length, so such arrays may be larger.
    if size <= MOST_REGISTERS:
        return size <= LONGEST_AXIS or max(shape) <= LONGEST_AXIS
    if FEWEST_ALWAYS <= shape[0] <= LANES:
        return size <= shape[0] * MOST_VECTORS
    # Tangents of vectors and of matrices; with two axes it is rather a state at each stage, or a matrix.
    return len(shape) > 2 and LANES < shape[0] <= MOST_ROWS and size <= shape[0] * MOST_PAIRS


def linear(builder: Builder, shape: Sequence[int], index: Sequence[Index]) -> Index:
    """Computes the position of an index, row by row."""
    position: Index = 0
    for i, length in zip(index, shape, strict=True):
        position = builder.plus(builder.times(position, length), 0 if length == 1 else i)
    return position


def unravel(builder: Builder, shape: Sequence[int], position: Index) -> list[Index]:
    """Computes the index of a position, row by row."""
    if isinstance(position, int):
        return [int(i) for i in np.unravel_index(position, shape)] if shape else []
    index: list[Index] = []
    for length in reversed(shape[1:]):
        if length == 1:
            index.append(0)
            continue
        index.append(builder.apply("urem", INDEX, position, length))
        position = builder.apply("udiv", INDEX, position, length)
    return [*([position] if shape else []), *index[::-1]]


def lane_of(builder: Builder, dtype: np.dtype, element: Element, lane: int) -> Element:
    """Returns one lane's number of an element."""
    if isinstance(element, Pair):
        part = part_of(dtype)
        return Pair(builder.lane(part, element.real, lane), builder.lane(part, element.imag, lane))
    return builder.lane(dtype, element, lane)


def load(builder: Builder, dtype: np.dtype, parts: Sequence[Name], wide: bool = False) -> Element:
    """Loads the number at an address, a complex one at two; a boolean is a byte. ``wide``: a vector of the lanes'
    numbers.
    """
    if dtype.kind == "c":
        return Pair(*(load(builder, part_of(dtype), [part], wide) for part in parts))
    # NumPy keeps a boolean in a byte, LLVM in a bit.
    kind = np.dtype(np.uint8) if dtype.kind == "b" else dtype
    number = builder.load(vector_type(kind) if wide else llvm_type(kind), parts[0], wide)
    return builder.apply("icmp ne", kind, number, kind.type(0)) if dtype.kind == "b" else number


def store(
    builder: Builder,
    dtype: np.dtype,
    element: Element,
    parts: Sequence[Name],
    wide: bool = False,
    mask: Element | None = None,
) -> None:
    """Writes a number to an address, or its parts to two, where the mask holds if there is one."""
    if dtype.kind == "c":
        for number, part in zip((element.real, element.imag), parts, strict=True):
            store(builder, part_of(dtype), number, [part], wide, mask)
        return
    if mask is not None:
        element = builder.select(dtype, mask, element, load(builder, dtype, parts, wide))
    kind = np.dtype(np.uint8) if dtype.kind == "b" else dtype
    if dtype.kind == "b":
        element = builder.convert("zext", dtype, kind, element) if isinstance(element, str) else kind.type(element)
    name = vector_type(kind) if wide else llvm_type(kind)
    builder.write(f"store {name} {builder.operand(kind, element, LANES * wide)}, ptr {parts[0]}")


def indices(shape: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Yields all indices, row by row."""
    return iter(np.ndindex(*shape))
