"""Reductions over dimensions and over windows."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...ir.elements import Element, Index, in_lanes
from ...ir.program import Operation
from ...limits import MOST_LOOPS, MOST_TERMS
from ..builder import INDEX
from ..instructions import BOOL
from ..lowering import Function
from ..rules import rule
from ..storage import join_parts, parts
from ..values import Array, Formula, Memory, Registers, is_small, size_of
from ..vectors import is_of_vectors, row_by_row, side_by_side
from .elementwise import as_array


@rule("stablehlo.reduce")
def reduce(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """Combines the elements along some dimensions by the region, from the first to the last."""
    storage, builder = function.storage, function.builder
    count = len(operands) // 2
    reduced = operation.attribute("dimensions")
    shape, dtypes = operands[0].shape, [array.dtype for array in operands[:count]]
    arrays = operands[:count]
    # What is left can be too large for registers where the whole is not: a first axis of a vector's length is gone.
    small = is_small(shape) and is_small(operation.results[0].shape)
    written_out = small and all(isinstance(array, Registers) for array in arrays)
    if not written_out:
        arrays = [storage.anywhere(storage.evaluate(array) if count > 1 else array) for array in arrays]
    first = [storage.to_registers(array).element(builder, ()) for array in operands[count:]]
    combine = function.combination(operation.regions[0])
    varying = in_lanes(*first) or any(array.varying for array in arrays)
    result_dimensions = [k for k in range(len(shape)) if k not in reduced]
    lengths = [shape[k] for k in reduced]

    def at(index: Sequence[Index]) -> list[Element]:
        place: list[Index] = [0] * len(shape)
        for k, i in zip(result_dimensions, index, strict=True):
            place[k] = i

        def step(within: list[Index], numbers: list[Element]) -> Sequence[Element]:
            for k, i in zip(reduced, within, strict=True):
                place[k] = i
            return combine(*numbers, *(array.element(builder, place) for array in arrays))

        most = size_of(lengths) if written_out else MOST_TERMS
        return storage.accumulate(lengths, list(zip(dtypes, first, strict=True)), step, most, varying)

    if written_out and result_dimensions[:1] == [0] and function.uses_vectors and is_of_vectors(shape):
        return _in_vectors(function, operation, arrays, first, reduced, combine)
    return several(function, operation, at, arrays, varying)


def _in_vectors(
    function: Function,
    operation: Operation,
    arrays: Sequence[Any],
    first: Sequence[Element],
    reduced: Any,
    combine: Any,
) -> list[Array]:
    """Combines the elements by the region in vectors, where the first axis stays and is as long as vectors are."""
    results = operation.results
    dtypes = [result.dtype for result in results]
    shape = results[0].shape
    table = [np.moveaxis(array.objects(), reduced, range(-len(reduced), 0)) for array in arrays]
    columns_of_results: list[list[list[Element]]] = [[] for _ in results]
    for place in np.ndindex(*shape[1:]):
        numbers = [[number] * shape[0] for number in first]
        for within in np.ndindex(*table[0].shape[len(shape) :]):
            columns = [*numbers, *(t[(slice(None), *place, *within)].tolist() for t in table)]
            numbers = side_by_side(function.builder, dtypes * 2, dtypes, columns, combine)
        for columns, column in zip(columns_of_results, numbers, strict=True):
            columns.append(column)
    return [
        Registers(dtype, as_array(row_by_row(columns), shape, dtype))
        for dtype, columns in zip(dtypes, columns_of_results, strict=True)
    ]


def several(function: Function, operation: Operation, at: Any, of: Sequence[Array], varying: bool) -> list[Array]:
    """Returns results of one shape, whose elements are computed together; ``varying``: they are vectors."""
    storage, results = function.storage, operation.results
    shape, dtypes = results[0].shape, [result.dtype for result in results]
    loops = any(not isinstance(array, Registers) for array in of)
    # What is summed in memory takes a loop for each element of the result: a few are in registers.
    if is_small(shape) and (not loops or size_of(shape) <= MOST_LOOPS):
        rows = [at(index) for index in np.ndindex(*shape)]
        columns = list(zip(*rows, strict=True)) or [()] * len(results)
        return [Registers(dtype, as_array(column, shape, dtype)) for dtype, column in zip(dtypes, columns, strict=True)]
    if len(results) == 1:
        formula = Formula(shape, dtypes[0], lambda index: at(index)[0], of, varying=varying)
        if not is_small(shape):
            return [formula]
        # One loop over all elements, and then few loads.
        return [storage.to_registers(storage.to_memory(formula))]
    targets = [storage.allocate(shape, dtype, varying) for dtype in dtypes]
    with storage.every_index(shape) as index:
        for target, element in zip(targets, at(index), strict=True):
            storage.put(target, index, element)
    return list(targets)


@rule("stablehlo.reduce_window")
def reduce_window(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """Combines the elements within each window by the region."""
    storage, builder = function.storage, function.builder
    count = len(operands) // 2
    arrays = [storage.evaluate(array) for array in operands[:count]]
    first = [storage.to_registers(array).element(builder, ()) for array in operands[count:]]
    combine = function.combination(operation.regions[0])
    varying = in_lanes(*first) or any(array.varying for array in arrays)
    window = _Window(operation, arrays[0].shape)
    # Window by window, a cumulative sum of n numbers would take n² additions.
    dimension = window.running()
    if dimension is not None:
        return _running(function, operation, arrays, first, combine, dimension, window.low[dimension] == 0)
    arrays = [storage.anywhere(array) for array in arrays]
    dtypes = [array.dtype for array in arrays]

    def at(index: Sequence[Index]) -> list[Element]:
        def step(within: list[Index], numbers: list[Element]) -> list[Element]:
            inside, place = window.place(builder, index, within)
            new = combine(*numbers, *(array.element(builder, place) for array in arrays))
            pairs = zip(parts(dtypes, new), parts(dtypes, numbers), strict=True)
            return join_parts(dtypes, [builder.select(dtype, inside, x, y) for (dtype, x), (_, y) in pairs])

        return storage.accumulate(window.lengths, list(zip(dtypes, first, strict=True)), step, varying=varying)

    return several(function, operation, at, arrays, varying)


@rule("stablehlo.select_and_scatter")
def select_and_scatter(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Combines the place that the first region selects in each window of the first operand with a number of the second,
    by the second region, to begin with the third.
    """
    storage, builder = function.storage, function.builder
    array, source = (storage.anywhere(storage.evaluate(operand)) for operand in operands[:2])
    first = storage.to_registers(operands[2]).element(builder, ())
    selects, combine = (function.combination(region) for region in operation.regions)
    window, dtype = _Window(operation, array.shape), array.dtype
    target = storage.allocate(array.shape, dtype)
    with storage.every_index(target.shape) as index:
        storage.put(target, index, first)
    # Its comparison does not count: the first element that lies within the array is taken, whatever it is.
    zero = join_parts([dtype], [part.type(0) for part, _ in parts([dtype], [first])])[0]
    with storage.every_index(source.shape) as index:

        def step(within: list[Index], best: list[Element]) -> list[Element]:
            inside, place = window.place(builder, index, within)
            number, is_found, *chosen = best
            other = array.element(builder, place)
            stays = builder.binary("and", BOOL, is_found, selects(number, other)[0])
            # Padding is never chosen, whatever would be compared with it.
            stays = builder.binary("or", BOOL, stays, builder.binary("xor", BOOL, inside, np.bool_(True)))
            pairs = zip(parts([dtype], [number]), parts([dtype], [other]), strict=True)
            new = join_parts([dtype], [builder.select(part, stays, x, y) for (part, x), (_, y) in pairs])
            numbers = [np.int64(i) if isinstance(i, int) else i for i in place]
            moved = [builder.select(INDEX, stays, i, j) for i, j in zip(chosen, numbers, strict=True)]
            return [*new, builder.binary("or", BOOL, is_found, inside), *moved]

        start = [(dtype, zero), (BOOL, np.bool_(False)), *[(INDEX, np.int64(0))] * len(array.shape)]
        _, is_found, *chosen = storage.accumulate(window.lengths, start, step)
        place = [builder.as_index(i, INDEX) for i in chosen]
        with builder.where(is_found):
            new = combine(target.element(builder, place), source.element(builder, index))
            storage.put(target, place, new[0])
    return target


class _Window:
    """Where windows lie on an array."""

    def __init__(self, operation: Operation, shape: tuple[int, ...]):
        ones = [1] * len(shape)

        def attribute(name: str, default: list[int]) -> list[int]:
            return operation.attribute(name) if operation.has(name) else default

        self.shape, self.lengths = shape, attribute("window_dimensions", ones)
        self.strides, self.apart = attribute("window_strides", ones), attribute("window_dilations", ones)
        self.spread = attribute("base_dilations", ones)
        edges = operation.attribute("padding") if operation.has("padding") else np.zeros((len(shape), 2), int)
        self.low = [int(low) for low, _ in edges]
        self.high = [int(high) for _, high in edges]

    def running(self) -> int | None:
        """Returns the dimension along which each window holds all elements up to its own, as in a cumulative sum."""
        long = [k for k, length in enumerate(self.lengths) if length > 1]
        plain = {*self.strides, *self.apart, *self.spread} <= {1}
        if len(long) != 1 or not plain or self.lengths[long[0]] != self.shape[long[0]]:
            return None
        (k,) = long
        others = [edge for d in range(len(self.shape)) if d != k for edge in (self.low[d], self.high[d])]
        edges = {self.low[k], self.high[k]}
        return k if not any(others) and edges == {0, self.lengths[k] - 1} else None

    def place(self, builder: Any, index: Sequence[Index], within: Sequence[Index]) -> tuple[Element, list[Index]]:
        """Returns whether there is an element at a place in the window of an index, and the index of that element."""
        inside, place = np.bool_(True), []
        for k, (i, j) in enumerate(zip(index, within, strict=True)):
            position = builder.plus(builder.times(i, self.strides[k]), builder.times(j, self.apart[k]))
            position = builder.plus(position, -self.low[k])
            within_base = builder.within(position, 0, (self.shape[k] - 1) * self.spread[k] + 1)
            if self.spread[k] > 1:
                number = np.int64(position) if isinstance(position, int) else position
                rest = builder.apply("srem", INDEX, number, np.int64(self.spread[k]))
                within_base = builder.binary("and", BOOL, within_base, builder.compare("eq", INDEX, rest, np.int64(0)))
                position = builder.apply("sdiv", INDEX, number, np.int64(self.spread[k]))
            inside = builder.binary("and", BOOL, inside, within_base)
            # It is read whether it is inside or not, so that it must lie in the array.
            place.append(builder.clamp(position, max(self.shape[k] - 1, 0)))
        return inside, place


def _running(
    function: Function,
    operation: Operation,
    arrays: Sequence[Registers | Memory],
    first: Sequence[Element],
    combine: Any,
    dimension: int,
    backwards: bool,
) -> list[Array]:
    """Combines all elements up to each one; ``backwards``: from each one on."""
    storage, builder = function.storage, function.builder
    shape, dtypes = arrays[0].shape, [array.dtype for array in arrays]
    length = shape[dimension]
    if is_small(shape) and all(isinstance(array, Registers) for array in arrays):
        results = [np.empty(shape, object) for _ in arrays]
        others = [1 if k == dimension else n for k, n in enumerate(shape)]
        for place in np.ndindex(*others):
            numbers = list(first)
            for i in range(length)[:: -1 if backwards else 1]:
                index = (*place[:dimension], i, *place[dimension + 1 :])
                numbers = list(combine(*numbers, *(array.element(builder, index) for array in arrays)))
                for result, number in zip(results, numbers, strict=True):
                    result[index] = number
        return [Registers(dtype, result) for dtype, result in zip(dtypes, results, strict=True)]
    sources = [storage.anywhere(array) for array in arrays]
    varying = in_lanes(*first) or any(array.varying for array in arrays)
    targets = [storage.allocate(shape, dtype, varying) for dtype in dtypes]
    if varying:
        first = [storage.spread(dtype, number) for dtype, number in zip(dtypes, first, strict=True)]
    others = [1 if k == dimension else n for k, n in enumerate(shape)]
    with storage.every_index(others) as place, builder.loop(0, length, *parts(dtypes, first)) as turn:
        i = builder.plus(builder.times(turn.index, -1), length - 1) if backwards else turn.index
        index = [i if k == dimension else j for k, j in enumerate(place)]
        numbers = combine(*join_parts(dtypes, turn.carried), *(source.element(builder, index) for source in sources))
        for target, number in zip(targets, numbers, strict=True):
            storage.put(target, index, number)
        turn.following = [number for _, number in parts(dtypes, numbers)]
    return list(targets)
