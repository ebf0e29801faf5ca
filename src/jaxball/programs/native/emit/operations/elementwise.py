"""Operations that compute each element of their result from the same elements of their operands."""

from collections.abc import Callable, Sequence

import numpy as np

from ...ir.elements import Element, UnsupportedError
from ...ir.program import Operation
from ..lowering import Function, rule
from ..scalars import ELEMENTWISE, complex, real, scalar
from ..values import Array, Formula, Memory, Registers, is_small, registers, size_of
from ..vectors import in_columns, is_of_vectors, row_by_row, side_by_side


def map_elements(
    function: Function, shape: tuple[int, ...], dtype: np.dtype, compute: Callable[..., Element], of: Sequence[Array]
) -> Array:
    """Returns the array of the results of ``compute`` for the elements; an operand of shape () is the same for all."""
    builder, storage = function.builder, function.storage
    if is_small(shape):
        if function.uses_vectors and is_of_vectors(shape):
            return _in_vectors(function, shape, dtype, compute, of)
        flat = []
        for array in of:
            elements = storage.to_registers(array).flat()
            flat.append(elements if array.shape == shape else elements * size_of(shape))
        return Registers(dtype, as_array([compute(*elements) for elements in zip(*flat, strict=True)], shape, dtype))
    # Nothing is computed yet: the loop that reads the result computes each element, and no array is written between.
    arrays = [storage.anywhere(array) for array in of]

    def at(index: Sequence[Element]) -> Element:
        return compute(*(array.element(builder, index if array.shape else ()) for array in arrays))

    return Formula(shape, dtype, at, arrays)


def _in_vectors(
    function: Function, shape: tuple[int, ...], dtype: np.dtype, compute: Callable[..., Element], of: Sequence[Array]
) -> Array:
    """Maps elements as :func:`map_elements`, but in vectors along the first axis, where that takes less time."""
    dtypes = [array.dtype for array in of]
    rows = [
        side_by_side(function.builder, dtypes, [dtype], columns, lambda *xs: (compute(*xs),))[0]
        for columns in in_columns(shape, [function.storage.to_registers(array).flat() for array in of])
    ]
    return Registers(dtype, as_array(row_by_row(rows), shape, dtype))


def as_array(elements: Sequence[Element], shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Returns an array of elements: of numbers if all are known."""
    if dtype.kind != "c" and not any(isinstance(element, str) for element in elements):
        return np.array(elements, dtype).reshape(shape)
    return registers(dtype, elements, shape).elements


@rule(*(f"stablehlo.{name}" for name in ELEMENTWISE), *(f"chlo.{name}" for name in ELEMENTWISE))
def elementwise(function: Function, operation: Operation, operands: list[Array]) -> Array:
    result, compute, builder = operation.results[0], scalar(operation), function.builder
    return map_elements(function, result.shape, result.dtype, lambda *xs: compute(builder, *xs), operands)


@rule("stablehlo.select")
def select(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Selects elements of the second operand where the condition holds, else of the third."""
    result, builder = operation.results[0], function.builder
    family = complex if result.dtype.kind == "c" else real
    compute = lambda condition, x, y: family.select(builder, result.dtype, condition, x, y)  # noqa: E731
    return map_elements(function, result.shape, result.dtype, compute, operands)


@rule("stablehlo.clamp")
def clamp(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Returns, for (low, x, high), the number in [low, high] next to x."""
    result, builder = operation.results[0], function.builder
    compute = lambda low, x, high: real.clamp(builder, result.dtype, low, x, high)  # noqa: E731
    return map_elements(function, result.shape, result.dtype, compute, operands)


@rule("stablehlo.complex")
def complex_of(function: Function, operation: Operation, operands: list[Array]) -> Array:
    result = operation.results[0]
    return map_elements(function, result.shape, result.dtype, complex.Pair, operands)


@rule("stablehlo.real", "stablehlo.imag")
def part(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Returns the real or the imaginary part; for a real number these are itself and 0."""
    result = operation.results[0]
    if operands[0].dtype.kind == "c":
        compute = scalar(operation)
        return map_elements(function, result.shape, result.dtype, lambda x: compute(function.builder, x), operands)
    zero = result.dtype.type(0)
    compute = (lambda x: x) if operation.short_name == "real" else (lambda x: zero)
    return map_elements(function, result.shape, result.dtype, compute, operands)


@rule("stablehlo.reduce_precision")
def reduce_precision(function: Function, operation: Operation, operands: list[Array]) -> Array:
    result, builder = operation.results[0], function.builder
    bits = operation.attribute("exponent_bits"), operation.attribute("mantissa_bits")
    compute = lambda x: real.reduce_precision(builder, result.dtype, x, *bits)  # noqa: E731
    return map_elements(function, result.shape, result.dtype, compute, operands)


@rule("stablehlo.bitcast_convert")
def bitcast_convert(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Returns the same bits as numbers of another type; where its length differs, with a dimension more or less, the
    lowest first.
    """
    (array,), result, storage = operands, operation.results[0], function.storage
    if array.dtype.itemsize == result.dtype.itemsize:
        compute = scalar(operation)
        return map_elements(function, result.shape, result.dtype, lambda x: compute(function.builder, x), operands)
    if "b" in (array.dtype.kind, result.dtype.kind):
        raise UnsupportedError(f"Bits of {array.dtype} as {result.dtype}")
    return Memory(result.shape, result.dtype, storage.to_memory(array).buffer)


@rule("stablehlo.map")
def map_(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Applies the region to the elements."""
    result, combine = operation.results[0], function.combination(operation.regions[0])
    return map_elements(function, result.shape, result.dtype, lambda *xs: combine(*xs)[0], operands)
