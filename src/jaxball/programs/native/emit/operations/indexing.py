"""Operations whose indices are numbers of the program: dynamic slices, gather and scatter."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...ir.elements import Element, Index, in_lanes
from ...ir.program import Operation
from ..instructions import BOOL
from ..lowering import Function
from ..rules import rule
from ..values import Array, Formula, Memory, Registers, is_small, size_of


def _starts(function: Function, operation: Operation, numbers: Sequence[Array], sizes: Sequence[int]) -> list[Index]:
    """Returns where a slice begins, moved so that it lies within the array."""
    builder, shape = function.builder, operation.operands[0].shape
    starts = []
    for array, length, size in zip(numbers, shape, sizes, strict=True):
        number = function.storage.to_registers(array).element(builder, ())
        starts.append(builder.clamp(builder.as_index(number, array.dtype), length - size))
    return starts


@rule("stablehlo.dynamic_slice")
def dynamic_slice(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Returns a slice of known lengths; one that would reach over the end begins earlier."""
    array, *numbers = operands
    result, builder = operation.results[0], function.builder
    starts = _starts(function, operation, numbers, result.shape)
    if isinstance(array, Registers) and array.has(starts):
        # An unknown start along an axis of length one can only be 0.
        first = [0 if isinstance(start, str) else start for start in starts]
        cut = tuple(slice(i, i + length) for i, length in zip(first, result.shape, strict=True))
        return Registers(array.dtype, array.elements[cut])
    array = function.storage.anywhere(array)

    def at(index: Sequence[Index]) -> Element:
        return array.element(builder, [builder.plus(i, start) for i, start in zip(index, starts, strict=True)])

    return Formula(result.shape, result.dtype, at, [array], cheap=True, varying=in_lanes(*starts))


@rule("stablehlo.dynamic_update_slice")
def dynamic_update_slice(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Returns the array with a slice replaced, in place where nobody reads the array afterwards."""
    array, update, *numbers = operands
    storage, builder = function.storage, function.builder
    starts = _starts(function, operation, numbers, update.shape)
    if isinstance(array, Registers) and is_small(array.shape) and all(isinstance(start, int) for start in starts):
        elements = array.objects().copy()
        cut = tuple(slice(i, i + length) for i, length in zip(starts, update.shape, strict=True))  # type: ignore[misc]
        elements[cut] = storage.to_registers(update).objects()
        return Registers(array.dtype, elements)
    update = storage.evaluate(update)  # it may follow from what is overwritten
    target = function.overwritable(operation, 0, array, update.varying or in_lanes(*starts))
    if isinstance(update, Registers):
        for index in np.ndindex(*update.shape):
            place = [builder.plus(i, start) for i, start in zip(index, starts, strict=True)]
            storage.put(target, place, update.element(builder, index))
        return target
    with storage.every_index(update.shape) as index:
        place = [builder.plus(i, start) for i, start in zip(index, starts, strict=True)]
        storage.put(target, place, update.element(builder, index))
    return target


@rule("stablehlo.gather")
def gather(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Slices that begin at indices; one that would reach over the end begins earlier."""
    array, numbers = operands
    result, builder, storage = operation.results[0], function.builder, function.storage
    n, sizes = operation.attribute("dimension_numbers"), operation.attribute("slice_sizes")
    offset = list(n.offset_dims)
    batch = [k for k in range(len(result.shape)) if k not in offset]
    slice_dimensions = [
        k for k in range(len(array.shape)) if k not in (*n.collapsed_slice_dims, *n.operand_batching_dims)
    ]
    indices_known = isinstance(numbers, Registers) and numbers.known and is_small(result.shape)
    numbers = storage.evaluate(numbers)
    # An index that is not known reads from memory, and then so do all. What only moves numbers that are there is not
    # copied for it: of a long table, such as a log, a step reads a few rows.
    array = array if isinstance(array, Formula) and array.cheap else storage.evaluate(array)
    array = array if indices_known else storage.anywhere(array)
    if not is_small(result.shape):
        numbers = storage.anywhere(numbers)

    def at(index: Sequence[Index]) -> Element:
        of_batch = [index[k] for k in batch]
        place: list[Index] = [0] * len(array.shape)
        for k, dimension in enumerate(n.start_index_map):
            i = _index_at(function, numbers, of_batch, n.index_vector_dim, k)
            place[dimension] = builder.clamp(i, array.shape[dimension] - sizes[dimension])
        for dimension, k in zip(n.operand_batching_dims, n.start_indices_batching_dims, strict=True):
            place[dimension] = of_batch[k - (k > n.index_vector_dim)]
        for dimension, k in zip(slice_dimensions, offset, strict=True):
            place[dimension] = builder.plus(place[dimension], index[k])
        return array.element(builder, place)

    return Formula(result.shape, result.dtype, at, [array, numbers])


def _index_at(function: Function, numbers: Array, of_batch: Sequence[Index], vector: int, k: int) -> Index:
    """Returns component k of the vector of indices of one slice."""
    place = list(of_batch)
    if vector < len(numbers.shape):
        place.insert(vector, k)
    return function.builder.as_index(numbers.element(function.builder, place), numbers.dtype)


@rule("stablehlo.scatter")
def scatter(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """Slices of the operands combined with updates, one after another; those that reach over the end are left out."""
    count = len(operands) // 2
    arrays, numbers, updates = operands[:count], operands[count], operands[count + 1 :]
    storage, builder = function.storage, function.builder
    if not size_of(updates[0].shape):
        return arrays
    places = _Places(function, operation, storage.evaluate(numbers), updates[0].shape)
    combine = function.combination(operation.regions[0])
    updates = [storage.evaluate(update) for update in updates]
    if places.known and all(isinstance(array, Registers) for array in (*arrays, *updates)):
        return _scatter_registers(function, places, combine, arrays, updates)
    varying = any(array.varying for array in (places.numbers, *arrays, *updates))
    # Updates are computed before, as they may read what is overwritten.
    targets = [function.overwritable(operation, k, array, varying) for k, array in enumerate(arrays)]

    def add_update(place: Sequence[Index], index: Sequence[Index]) -> None:
        old = [target.element(builder, place) for target in targets]
        new = combine(*old, *(update.element(builder, index) for update in updates))
        for target, element in zip(targets, new, strict=True):
            storage.put(target, place, element)

    # Numbers in registers cannot be found by the index of a loop, so each update has its instructions.
    if all(isinstance(array, Registers) for array in (*updates, places.numbers)) and is_small(updates[0].shape):
        for window in filter(None, places.slices()):
            with builder.where(places.of(window[0])[0]):
                for index in window:
                    add_update(places.of(index)[1], index)
        return list(targets)
    if size_of(updates[0].shape) > 1:
        updates, places.numbers = [storage.anywhere(update) for update in updates], storage.anywhere(places.numbers)
    with storage.every_index(updates[0].shape) as index:
        inside, place = places.of(index)
        with builder.where(inside):
            add_update(place, index)
    return list(targets)


class _Places:
    """Where the updates of a scatter go."""

    def __init__(self, function: Function, operation: Operation, numbers: Registers | Memory, update: tuple[int, ...]):
        self.function, self.shape, self.update = function, operation.operands[0].shape, update
        self.numbers: Array = numbers
        self.n: Any = operation.attribute("scatter_dimension_numbers")
        self.known = isinstance(numbers, Registers) and numbers.known
        windows = list(self.n.update_window_dims)
        left_out = (*self.n.inserted_window_dims, *self.n.input_batching_dims)
        self.kept = [k for k in range(len(self.shape)) if k not in left_out]
        self.windows = windows
        self.batch = [k for k in range(len(update)) if k not in windows]

    def slices(self) -> Iterator[list[tuple[int, ...]]]:
        """Yields the indices of the updates, slice by slice."""
        for of_batch in np.ndindex(*(self.update[k] for k in self.batch)):
            indices = []
            for of_window in np.ndindex(*(self.update[k] for k in self.windows)):
                index = [0] * len(self.update)
                for k, i in [*zip(self.batch, of_batch, strict=True), *zip(self.windows, of_window, strict=True)]:
                    index[k] = i
                indices.append(tuple(index))
            yield indices

    def of(self, index: Sequence[Index]) -> tuple[Element, list[Index]]:
        """Returns whether the slice of an update lies within the array, and where the update goes."""
        b, n = self.function.builder, self.n
        of_batch = [index[k] for k in self.batch]
        start: list[Index] = [0] * len(self.shape)
        for k, dimension in enumerate(n.scattered_dims_to_operand_dims):
            start[dimension] = _index_at(self.function, self.numbers, of_batch, n.index_vector_dim, k)
        for dimension, k in zip(n.input_batching_dims, n.scatter_indices_batching_dims, strict=True):
            start[dimension] = of_batch[k - (k > n.index_vector_dim)]
        lengths = [1] * len(self.shape)
        place = list(start)
        for dimension, k in zip(self.kept, self.windows, strict=True):
            lengths[dimension] = self.update[k]
            place[dimension] = b.plus(start[dimension], index[k])
        inside: Element = np.bool_(True)
        for i, length, size in zip(start, self.shape, lengths, strict=True):
            # A slice that is longer than the array lies within it nowhere.
            if length >= size:
                inside = b.binary("and", BOOL, inside, b.within(i, 0, length - size + 1))
            else:
                inside = np.bool_(False)
        if in_lanes(inside):  # where an update is left out, its place is read, and written as it was
            place = [b.clamp(i, length - 1) for i, length in zip(place, self.shape, strict=True)]
        return inside, place


def _scatter_registers(
    function: Function, places: _Places, combine: Any, arrays: Sequence[Array], updates: Sequence[Array]
) -> list[Array]:
    results = [function.storage.to_registers(array).objects().copy() for array in arrays]
    for index in np.ndindex(*updates[0].shape):
        inside, place = places.of(index)
        if inside:
            where: Any = tuple(place)
            new = combine(
                *(result[where] for result in results),
                *(update.element(function.builder, index) for update in updates),
            )
            for result, element in zip(results, new, strict=True):
                result[where] = element
    return [Registers(array.dtype, result) for array, result in zip(arrays, results, strict=True)]
