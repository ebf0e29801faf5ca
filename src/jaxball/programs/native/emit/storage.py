"""Moves arrays to where an operation needs them: memory, registers, or memory that may be overwritten."""

import contextlib
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..ir.elements import Element, Index, Pair, part_of
from ..limits import LANES, MOST_TERMS
from .buffers import Buffer, Buffers
from .values import Array, Formula, Memory, Registers, indices, is_small, size_of


class Storage(Buffers):
    """The arrays of one function."""

    def allocate(self, shape: Sequence[int], dtype: np.dtype, lanes: bool = False) -> Memory:
        """Allocates an array with nothing in it yet; ``lanes``: one for each lane."""
        # An empty array has an address too, and a size of 0 would mean that its memory is not used again.
        size = max(size_of(shape) * dtype.itemsize, 8) * (LANES if lanes else 1)
        return Memory(tuple(shape), dtype, self.allocate_buffer(size, lanes))

    def to_memory(self, array: Array) -> Memory:
        """Returns the same numbers in memory."""
        if isinstance(array, Memory):
            return array
        if isinstance(array, Registers) and array.twin is not None:
            # The loop read these numbers into registers, and left them where they were as well.
            return array.twin
        if isinstance(array, Registers) and array.known:
            return Memory(array.shape, array.dtype, Buffer(self.builder.module.constant(array.elements), 0, False))
        return self.copy_of(array)

    def to_registers(self, array: Array) -> Registers:
        """Returns the same numbers in registers, however many they are."""
        if isinstance(array, Registers):
            return array
        elements = np.empty(array.shape, object)
        flat = elements.reshape(-1)
        for position, index in enumerate(indices(array.shape)):
            flat[position] = array.element(self.builder, index)
        return Registers(array.dtype, elements)

    def evaluate(self, array: Array) -> Registers | Memory:
        """Returns the same numbers, computed: in registers where they are few."""
        if not isinstance(array, Formula):
            return array
        return self.to_registers(array) if is_small(array.shape) else self.to_memory(array)

    def anywhere(self, array: Array) -> Array:
        """Returns the same numbers where an index need not be known; a single number may stay in its register."""
        if not isinstance(array, Registers) or size_of(array.shape) == 1:
            return array
        # A constant of equal numbers, such as zeros, needs no memory.
        if array.known and is_uniform(array.elements):
            number = array.element(self.builder, [0] * len(array.shape))
            return Formula(array.shape, array.dtype, lambda index: number, (), cheap=True)
        if array.known and 0 in array.elements.strides:
            return self._repeated(array)
        return self.to_memory(array)

    def _repeated(self, array: Registers) -> Formula:
        """Returns a constant that repeats its numbers along some axes, with memory for those that differ alone.

        The text of a joint's losses and their derivative had 43 MB, of which 39 were the same two numbers.
        """
        own = [stride != 0 for stride in array.elements.strides]
        first = array.elements[tuple(slice(None) if differs else slice(1) for differs in own)]
        memory = self.to_memory(Registers(array.dtype, first))

        def at(index: Sequence[Index]) -> Element:
            return memory.element(self.builder, [i if differs else 0 for i, differs in zip(index, own, strict=True)])

        return Formula(array.shape, array.dtype, at, (memory,), cheap=True)

    def fill(self, target: Memory, source: Array) -> None:
        """Writes all numbers of an array to memory."""
        builder = self.builder
        if isinstance(source, Registers) and source.known and not is_small(source.shape):
            source = self.anywhere(source)  # by a loop: otherwise each number is an instruction
        # A copy of bytes knows no masks.
        everywhere = builder.mask is None or target.buffer.level == builder.level
        if isinstance(source, Memory) and everywhere and source.varying == target.varying:
            size = size_of(source.shape) * source.dtype.itemsize * (LANES if source.varying else 1)
            builder.copy(target.buffer.name, source.buffer.name, size)
        elif isinstance(source, Registers):
            for index in indices(source.shape):
                target.put(builder, index, source.element(builder, index))
        # What is there already need not be written, masked or not.
        elif not isinstance(source, Memory) or source.buffer.name != target.buffer.name:
            with self.every_index(source.shape) as index:
                target.put(builder, index, source.element(builder, index))

    def copy_of(self, array: Array, lanes: bool = False) -> Memory:
        """Copies the numbers to memory of their own; ``lanes``: to memory of each lane's own, also where they are the
        same.
        """
        target = self.allocate(array.shape, array.dtype, lanes or array.varying)
        self.fill(target, array)
        return target

    def move(self, moves: Sequence[tuple[Memory, Array]]) -> None:
        """Fills targets with sources as if at once: x, y ← y, x needs a copy."""
        names = {target.buffer.name for target, _ in moves}
        rest = []
        for target, source in moves:
            if isinstance(source, Memory) and source.buffer.name == target.buffer.name:
                continue
            # Copied also where it is its own target, if a formula reads it: in reverse, for instance.
            if any(buffer.name in names for buffer in source.buffers):
                source = self.copy_of(source)
            rest.append((target, source))
        for target, source in rest:
            self.fill(target, source)

    def put(self, target: Memory, index: Sequence[Index], element: Element) -> None:
        """Writes an element."""
        target.put(self.builder, index, element)

    def view_of(self, array: Memory, shape: tuple[int, ...]) -> Memory:
        """Returns the same memory as an array of another shape."""
        return Memory(shape, array.dtype, array.buffer)

    def accumulate(
        self,
        shape: Sequence[int],
        start: Sequence[tuple[np.dtype, Element]],
        step: Callable[[list[Index], list[Element]], Sequence[Element]],
        most_steps: int = MOST_TERMS,
        varying: bool = False,
    ) -> list[Element]:
        """Applies ``step(index, numbers)`` to some numbers for every index of a shape, in order, and returns the
        numbers that result.

        Up to ``most_steps`` are written one after another, more are a loop. ``varying``: they become vectors.
        """
        dtypes, numbers = [dtype for dtype, _ in start], [number for _, number in start]

        def spread() -> list[Element]:
            return list(map(self.spread, dtypes, numbers)) if varying else numbers

        if size_of(shape) <= most_steps:
            # Not before: a number that is known is left out of the first sum, and the others are rounded accordingly.
            for index in indices(shape):
                numbers = list(step(list(index), numbers))
            return spread()
        # A phi that begins as one number cannot become a vector in a later turn.
        return self._accumulate(list(shape), [], dtypes, spread(), step)

    def spread(self, dtype: np.dtype, number: Element) -> Element:
        """Returns a number that all lanes have."""
        if isinstance(number, Pair):
            return Pair(*(self.builder.spread(part_of(dtype), part) for part in (number.real, number.imag)))
        return self.builder.spread(dtype, number)

    def _accumulate(
        self,
        shape: list[int],
        outer: list[Index],
        dtypes: list[np.dtype],
        numbers: list[Element],
        step: Callable[[list[Index], list[Element]], Sequence[Element]],
    ) -> list[Element]:
        if not shape:
            return list(step(outer, numbers))
        if shape[0] == 1:
            return self._accumulate(shape[1:], [*outer, 0], dtypes, numbers, step)
        carried = list(parts(dtypes, numbers))
        with self.builder.loop(0, shape[0], *carried) as turn:
            inner = join_parts(dtypes, turn.carried)
            new = self._accumulate(shape[1:], [*outer, turn.index], dtypes, inner, step)
            turn.following = [number for _, number in parts(dtypes, new)]
        return join_parts(dtypes, turn.following)

    @contextlib.contextmanager
    def every_index(self, shape: Sequence[int]) -> Iterator[list[Index]]:
        """Loops over all indices of a shape, in which what is written in this block of Python is executed."""
        with contextlib.ExitStack() as stack:
            if not size_of(shape):  # written, and never executed
                stack.enter_context(self.builder.where(np.bool_(False)))
            yield [stack.enter_context(self.builder.loop(0, length)).index if length > 1 else 0 for length in shape]


def parts(dtypes: Sequence[np.dtype], numbers: Sequence[Element]) -> Iterator[tuple[np.dtype, Element]]:
    """Yields numbers that have a place in a register: for a complex one its two parts."""
    for dtype, number in zip(dtypes, numbers, strict=True):
        if dtype.kind == "c":
            yield part_of(dtype), number.real
            yield part_of(dtype), number.imag
        else:
            yield dtype, number


def parts_of(dtype: np.dtype, count: int) -> list[np.dtype]:
    """Returns the types of the parts that ``count`` numbers are made of."""
    return [part_of(dtype)] * (2 * count if dtype.kind == "c" else count)


def join_parts(dtypes: Sequence[np.dtype], numbers: Sequence[Element]) -> list[Element]:
    """Joins the parts of numbers to these numbers again."""
    rest = iter(numbers)
    return [Pair(next(rest), next(rest)) if dtype.kind == "c" else next(rest) for dtype in dtypes]


def is_uniform(numbers: np.ndarray) -> bool:
    """Returns whether an array is one number, viewed or repeated, to the last bit."""
    if not numbers.size:
        return False
    if not any(numbers.strides):
        return True
    # By bytes, because 0 equals −0, and NaN does not equal itself.
    first = numbers.reshape(-1)[:1]
    return numbers.tobytes() == first.tobytes() * numbers.size
