"""Operations that move elements: of registers at once, of memory by arithmetic on indices."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ...ir.elements import Element, Index
from ...ir.program import Operation
from ..lowering import Function, rule
from ..scalars import complex, real
from ..values import Array, Formula, Registers, is_small, linear, unravel


def rearrange(
    function: Function,
    operation: Operation,
    array: Array,
    of_registers: Callable[[np.ndarray], np.ndarray],
    source: Callable[[Sequence[Index]], Sequence[Index]],
) -> Array:
    """Rearranges an array: ``of_registers`` does so for an array of NumPy, and ``source`` says where the element of an
    index comes from.
    """
    result = operation.results[0]
    if isinstance(array, Registers) and (array.known or is_small(result.shape)):
        return Registers(array.dtype, of_registers(array.elements))
    # Few elements are read one by one, and a formula that computes would compute each again.
    if is_small(result.shape) and isinstance(array, Formula) and (is_small(array.shape) or not array.cheap):
        array = function.storage.evaluate(array)
        return rearrange(function, operation, array, of_registers, source)
    array = function.storage.anywhere(array)
    return Formula(
        result.shape,
        result.dtype,
        lambda index: array.element(function.builder, source(index)),
        [array],
        cheap=True,
    )


@rule("stablehlo.constant")
def constant(function: Function, operation: Operation, operands: list[Array]) -> Array:
    return Registers(operation.results[0].dtype, operation.constant())


@rule("stablehlo.iota")
def iota(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Makes an array in which each element is its own index in one dimension."""
    result, dimension = operation.results[0], operation.attribute("iota_dimension")
    shape, dtype, builder = result.shape, result.dtype, function.builder
    if is_small(shape):
        numbers = np.arange(shape[dimension]).astype(dtype)
        others = [k for k in range(len(shape)) if k != dimension]
        return Registers(dtype, np.broadcast_to(np.expand_dims(numbers, others), shape))
    conversion = complex.convert if dtype.kind == "c" else real.convert

    def at(index: Sequence[Index]) -> Element:
        i = index[dimension]
        return conversion(builder, np.dtype(np.int64), dtype, np.int64(i) if isinstance(i, int) else i)

    return Formula(shape, dtype, at, (), cheap=True)


@rule("stablehlo.broadcast_in_dim")
def broadcast_in_dim(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Broadcasts the operand: its dimension k is dimension d[k] of the result; one of length 1 is repeated."""
    dimensions, shape = operation.attribute("broadcast_dimensions"), operation.results[0].shape
    old = operands[0].shape

    def of_registers(elements: np.ndarray) -> np.ndarray:
        lengths = [1] * len(shape)
        for k, d in enumerate(dimensions):
            lengths[d] = old[k]
        order = np.argsort(dimensions, kind="stable") if len(dimensions) > 1 else range(len(dimensions))
        return np.broadcast_to(elements.transpose(order).reshape(lengths), shape)

    def source(index: Sequence[Index]) -> list[Index]:
        return [0 if old[k] == 1 else index[d] for k, d in enumerate(dimensions)]

    return rearrange(function, operation, operands[0], of_registers, source)


@rule("stablehlo.reshape")
def reshape(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Returns the same elements in the same order, in the shape of the result."""
    array, shape = operands[0], operation.results[0].shape
    builder = function.builder
    if not isinstance(array, Registers) and not is_small(shape) and _unit_free(array.shape) == _unit_free(shape):
        # Only dimensions of length one differ. By the position, each index would take divisions.
        old_axes = [k for k, length in enumerate(array.shape) if length != 1]
        new_axes = [k for k, length in enumerate(shape) if length != 1]

        def source(index: Sequence[Index]) -> list[Index]:
            old: list[Index] = [0] * len(array.shape)
            for k, d in zip(old_axes, new_axes, strict=True):
                old[k] = index[d]
            return old

        return rearrange(function, operation, array, lambda elements: elements.reshape(shape), source)
    by_position = lambda index: unravel(builder, array.shape, linear(builder, shape, index))  # noqa: E731
    if isinstance(array, Formula) and array.cheap and len(array.shape) == 1 and not is_small(shape):
        return rearrange(function, operation, array, lambda elements: elements.reshape(shape), by_position)
    if not isinstance(array, Registers) and not is_small(shape):
        # Elements lie row by row whatever the shape, so this is the same memory.
        return function.storage.view_of(function.storage.to_memory(array), shape)
    return rearrange(function, operation, array, lambda elements: elements.reshape(shape), by_position)


def _unit_free(shape: Sequence[int]) -> list[int]:
    return [length for length in shape if length != 1]


@rule("stablehlo.transpose")
def transpose(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Permutes dimensions: dimension k of the result is dimension p[k] of the operand."""
    permutation = operation.attribute("permutation")

    def source(index: Sequence[Index]) -> list[Index]:
        old: list[Index] = [0] * len(permutation)
        for k, d in enumerate(permutation):
            old[d] = index[k]
        return old

    return rearrange(function, operation, operands[0], lambda elements: elements.transpose(permutation), source)


@rule("stablehlo.slice")
def slice_(function: Function, operation: Operation, operands: list[Array]) -> Array:
    start, stride = operation.attribute("start_indices"), operation.attribute("strides")
    cut = tuple(map(slice, start, operation.attribute("limit_indices"), stride))
    builder = function.builder

    def source(index: Sequence[Index]) -> list[Index]:
        return [builder.plus(builder.times(i, by), first) for i, by, first in zip(index, stride, start, strict=True)]

    return rearrange(function, operation, operands[0], lambda elements: elements[cut], source)


@rule("stablehlo.reverse")
def reverse(function: Function, operation: Operation, operands: list[Array]) -> Array:
    dimensions, shape = operation.attribute("dimensions"), operands[0].shape
    builder = function.builder

    def source(index: Sequence[Index]) -> list[Index]:
        return [builder.plus(builder.times(i, -1), shape[k] - 1) if k in dimensions else i for k, i in enumerate(index)]

    return rearrange(function, operation, operands[0], lambda elements: np.flip(elements, dimensions), source)


@rule("stablehlo.concatenate")
def concatenate(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Joins the operands one after another along a dimension."""
    result, dimension = operation.results[0], operation.attribute("dimension")
    storage = function.storage
    if is_small(result.shape):
        parts = [storage.to_registers(array) for array in operands]
        all_known = all(part.known for part in parts)
        arrays = [part.elements if all_known else part.objects() for part in parts]
        return Registers(result.dtype, np.concatenate(arrays, axis=dimension))
    varying = any(array.varying for array in operands)
    target, offset = storage.allocate(result.shape, result.dtype, varying), 0
    for array in operands:
        write_part(function, target, storage.anywhere(array), dimension, offset)
        offset += array.shape[dimension]
    return target


def write_part(function: Function, target: Any, array: Array, dimension: int, offset: int) -> None:
    """Writes an array into another, from an index of one dimension on."""
    storage, builder = function.storage, function.builder
    with storage.every_index(array.shape) as index:
        place = list(index)
        place[dimension] = builder.plus(place[dimension], offset)
        storage.put(target, place, array.element(builder, index))


@rule("stablehlo.pad")
def pad(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Puts a number around the operand and between its elements; negative edges are cut off."""
    array, fill = operands
    result = operation.results[0]
    low, interior = operation.attribute("edge_padding_low"), operation.attribute("interior_padding")
    storage, builder = function.storage, function.builder
    number = storage.to_registers(fill).element(builder, ())
    if is_small(result.shape):
        padded = np.empty(result.shape, object)
        for index in np.ndindex(*result.shape):
            padded[index] = number
        objects = storage.to_registers(array).objects()
        for index in np.ndindex(*array.shape):
            place = tuple(edge + i * (gap + 1) for i, edge, gap in zip(index, low, interior, strict=True))
            if all(0 <= i < length for i, length in zip(place, result.shape, strict=True)):
                padded[place] = objects[index]
        return Registers(result.dtype, padded)
    target = storage.allocate(result.shape, result.dtype, any(array.varying for array in operands))
    with storage.every_index(result.shape) as index:
        storage.put(target, index, number)
    source = storage.anywhere(array)
    with storage.every_index(array.shape) as index:
        place = [
            builder.plus(builder.times(i, gap + 1), edge) for i, edge, gap in zip(index, low, interior, strict=True)
        ]
        ends = zip(place, result.shape, low, operation.attribute("edge_padding_high"), strict=True)
        inside: Element = np.bool_(True)
        for i, length, *edges in ends:
            # Elsewhere every element has a place, and nothing is compared in the loop.
            if min(edges) < 0:
                inside = builder.binary("and", real.BOOL, inside, builder.within(i, 0, length))
        with builder.where(inside):
            storage.put(target, place, source.element(builder, index))
    return target


@rule("stablehlo.optimization_barrier")
def optimization_barrier(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    return operands
