"""Products of matrices and of higher arrays."""

import functools
from collections.abc import Callable, Sequence

import numpy as np

from ..builder import Builder
from ..elements import Element, Index, is_known
from ..lowering import Function
from ..program import Operation
from ..rules import rule
from ..values import Array, Formula, Registers, is_small, size_of
from ..vectors import WIDTHS, side_by_side
from . import complex, real
from .elementwise import collected

PARTIAL_SUMS = 4
MOST_PRODUCTS = 512  # of one operation that are written out; more are loops


@rule("stablehlo.dot_general")
def dot_general(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Sums of products over the dimensions contracted; those of the batch come first, then each operand's others."""
    storage, builder = function.storage, function.builder
    result, n = operation.results[0], operation.attribute("dot_dimension_numbers")
    batch = list(zip(n.lhs_batching_dimensions, n.rhs_batching_dimensions, strict=True))
    contracted = list(zip(n.lhs_contracting_dimensions, n.rhs_contracting_dimensions, strict=True))
    left, right = (storage.settled(array) for array in operands)
    lengths = [left.shape[k] for k, _ in contracted]
    free = [
        [k for k in range(len(array.shape)) if all(k != pair[side] for pair in (*batch, *contracted))]
        for side, array in enumerate((left, right))
    ]
    family, dtype = complex if result.dtype.kind == "c" else real, result.dtype

    def converted(array: Array, place: Sequence[Index]) -> Element:
        conversion = complex.convert if dtype.kind == "c" and array.dtype.kind != "c" else family.convert
        element = array.element(builder, place)
        return element if array.dtype == dtype else conversion(builder, array.dtype, dtype, element)

    def factors(index: Sequence[Index], within: Sequence[Index]) -> tuple[Element, Element]:
        places: list[list[Index]] = [[0] * len(left.shape), [0] * len(right.shape)]
        for i, pair in [*zip(index, batch, strict=False), *zip(within, contracted, strict=True)]:
            for side in (0, 1):
                places[side][pair[side]] = i
        rest = iter(index[len(batch) :])
        for side in (0, 1):
            for k in free[side]:
                places[side][k] = next(rest)
        return converted(left, places[0]), converted(right, places[1])

    def multiplied(x: Element, y: Element) -> Element:
        return family.SCALARS["multiply"](builder, dtype, x, y)

    def added(x: Element, y: Element) -> Element:
        return family.SCALARS["add"](builder, dtype, x, y)

    def at(index: Sequence[Index]) -> Element:
        def product(within: Sequence[Index]) -> Element:
            return multiplied(*factors(index, within))

        def step(within: list[Index], numbers: list[Element]) -> list[Element]:
            return [added(numbers[0], product(within))]

        # −0 is what leaves every number as it is.
        zero = dtype.type(-0.0) if dtype.kind == "f" else complex.Pair(*[dtype.type(-0.0).real] * 2)
        start = [(dtype, dtype.type(0) if dtype.kind in "iub" else zero)]
        if not size_of(lengths):
            zero = dtype.type(0)
            return complex.Pair(zero.real, zero.imag) if dtype.kind == "c" else zero
        if written_out:
            return _sum_of(added, [product(within) for within in np.ndindex(*lengths)])
        return storage.accumulated(lengths, start, step, varying=left.varying or right.varying)[0]

    written_out = False
    if is_small(result.shape) and size_of(result.shape) * size_of(lengths) <= MOST_PRODUCTS:
        written_out = size_of(lengths) <= 16 or all(isinstance(array, Registers) for array in (left, right))
        if not written_out:
            left, right = storage.anywhere(left), storage.anywhere(right)
        elif batch and result.shape[0] in WIDTHS and size_of(lengths):
            pairs = lambda index: [x for within in np.ndindex(*lengths) for x in factors(index, within)]  # noqa: E731
            sums = lambda *xs: [_sum_of(added, [*map(multiplied, xs[::2], xs[1::2])])]  # noqa: E731
            return _in_vectors(builder, dtype, result.shape, pairs, sums)
        elements = [at(index) for index in np.ndindex(*result.shape)]
        return Registers(dtype, collected(elements, result.shape, dtype))
    left, right = storage.anywhere(left), storage.anywhere(right)
    formula = Formula(result.shape, dtype, at, [left, right])
    return storage.to_memory(formula)


def _in_vectors(
    builder: Builder,
    dtype: np.dtype,
    shape: tuple[int, ...],
    operands: Callable[[Sequence[Index]], list[Element]],
    compute: Callable[..., Sequence[Element]],
) -> Array:
    """What is computed of the operands of each index, in vectors along the first axis."""
    found = []
    for place in np.ndindex(*shape[1:]):
        rows = [operands((lane, *place)) for lane in range(shape[0])]
        columns = list(zip(*rows, strict=True))
        vectors = side_by_side(builder, [dtype] * len(columns), [dtype], columns, compute)
        found.append([compute(*row)[0] for row in rows] if vectors is None else vectors[0])
    return Registers(dtype, collected([number for lane in zip(*found, strict=True) for number in lane], shape, dtype))


def _sum_of(add: Callable[[Element, Element], Element], numbers: Sequence[Element]) -> Element:
    """A sum of many terms as that of several sums, which a processor adds at once."""
    known, others = [x for x in numbers if is_known(x)], [x for x in numbers if not is_known(x)]
    apart = PARTIAL_SUMS if len(others) >= 2 * PARTIAL_SUMS else 1
    sums = [functools.reduce(add, others[first::apart]) for first in range(apart) if others]
    sums += [functools.reduce(add, known)] if known else []
    while len(sums) > 1:
        sums = [add(*sums[k : k + 2]) if k + 1 < len(sums) else sums[k] for k in range(0, len(sums), 2)]
    return sums[0]
