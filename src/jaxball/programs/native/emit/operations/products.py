"""Products of matrices and of higher arrays."""

import functools
from collections.abc import Sequence

import numpy as np

from ...ir.elements import Element, Index, is_known
from ...ir.program import Operation
from ...limits import MOST_PRODUCTS, MOST_TERMS, PARTIAL_SUMS
from ..lowering import Function, rule
from ..scalars import complex, real
from ..values import Array, Formula, Registers, is_small, size_of
from ..vectors import is_of_vectors, row_by_row, side_by_side
from .elementwise import as_array


@rule("stablehlo.dot_general")
def dot_general(function: Function, operation: Operation, operands: list[Array]) -> Array:
    """Sums of products over the dimensions contracted; those of the batch come first, then each operand's others."""
    storage, (result,) = function.storage, operation.results
    products = _Products(function, operation, [storage.evaluate(array) for array in operands])
    shape, count = result.shape, size_of(products.lengths)
    if is_small(shape) and size_of(shape) * count <= MOST_PRODUCTS:
        in_registers = all(isinstance(array, Registers) for array in products.operands)
        if in_registers and count and products.batch and function.uses_vectors and is_of_vectors(shape):
            return products.in_vectors(shape)
        # Factors in registers have no index that a loop could count.
        if count <= MOST_TERMS or in_registers:
            element = products.write_sum
        else:
            products.operands, element = [storage.anywhere(array) for array in products.operands], products.in_loop
        elements = [element(index) for index in np.ndindex(*shape)]
        return Registers(result.dtype, as_array(elements, shape, result.dtype))
    products.operands = [storage.anywhere(array) for array in products.operands]
    return storage.to_memory(Formula(shape, result.dtype, products.in_loop, products.operands))


class _Products:
    """The products of which a ``dot_general`` of two operands gives the sums.

    - ``batch``, ``contracted``: pairs of dimensions of the operands, over which the sums are ``lengths`` long.
    """

    def __init__(self, function: Function, operation: Operation, operands: Sequence[Array]):
        n = operation.attribute("dot_dimension_numbers")
        self.operands, self.dtype = operands, operation.results[0].dtype
        self.batch = list(zip(n.lhs_batching_dimensions, n.rhs_batching_dimensions, strict=True))
        self.contracted = list(zip(n.lhs_contracting_dimensions, n.rhs_contracting_dimensions, strict=True))
        self.lengths = [operands[0].shape[k] for k, _ in self.contracted]
        self._free = [
            [k for k in range(len(array.shape)) if all(k != pair[side] for pair in (*self.batch, *self.contracted))]
            for side, array in enumerate(operands)
        ]
        self._storage, self._builder = function.storage, function.builder
        self._family = complex if self.dtype.kind == "c" else real

    def in_vectors(self, shape: tuple[int, ...]) -> Array:
        """Computes all sums, in vectors along the first dimension."""
        sums = []
        for place in np.ndindex(*shape[1:]):
            rows = [self._factors_at((lane, *place)) for lane in range(shape[0])]
            columns, dtypes = list(zip(*rows, strict=True)), [self.dtype] * len(rows[0])
            sums += side_by_side(self._builder, dtypes, [self.dtype], columns, lambda *row: [self._sum(row)])
        return Registers(self.dtype, as_array(row_by_row(sums), shape, self.dtype))

    def write_sum(self, index: Sequence[Index]) -> Element:
        """Writes the sum at an index of the result."""
        return self._sum(self._factors_at(index)) if size_of(self.lengths) else self._zero()

    def in_loop(self, index: Sequence[Index]) -> Element:
        """Computes the sum at an index of the result in a loop, one product after another."""
        if not size_of(self.lengths):
            return self._zero()
        # −0 is what leaves every number as it is.
        minus = self.dtype.type(-0.0) if self.dtype.kind == "f" else complex.Pair(*[self.dtype.type(-0.0).real] * 2)
        start = [(self.dtype, self.dtype.type(0) if self.dtype.kind in "iub" else minus)]

        def step(within: list[Index], numbers: list[Element]) -> list[Element]:
            return [self._add(numbers[0], self._multiply(*self._factors(index, within)))]

        varying = any(array.varying for array in self.operands)
        return self._storage.accumulate(self.lengths, start, step, varying=varying)[0]

    def _factors_at(self, index: Sequence[Index]) -> list[Element]:
        """Lists the factors of all products of one sum."""
        return [x for within in np.ndindex(*self.lengths) for x in self._factors(index, within)]

    def _factors(self, index: Sequence[Index], within: Sequence[Index]) -> list[Element]:
        places: list[list[Index]] = [[0] * len(array.shape) for array in self.operands]
        for i, pair in [*zip(index, self.batch, strict=False), *zip(within, self.contracted, strict=True)]:
            for side in (0, 1):
                places[side][pair[side]] = i
        rest = iter(index[len(self.batch) :])
        for side in (0, 1):
            # Behind the batch, the result has the free dimensions of the first operand, then those of the second.
            for k in self._free[side]:
                places[side][k] = next(rest)
        return [self._convert(array, place) for array, place in zip(self.operands, places, strict=True)]

    def _convert(self, array: Array, place: Sequence[Index]) -> Element:
        to_complex = self.dtype.kind == "c" and array.dtype.kind != "c"
        element = array.element(self._builder, place)
        if array.dtype == self.dtype:
            return element
        return (complex if to_complex else self._family).convert(self._builder, array.dtype, self.dtype, element)

    def _zero(self) -> Element:
        zero = self.dtype.type(0)
        return complex.Pair(zero.real, zero.imag) if self.dtype.kind == "c" else zero

    def _multiply(self, x: Element, y: Element) -> Element:
        return self._family.SCALARS["multiply"](self._builder, self.dtype, x, y)

    def _add(self, x: Element, y: Element) -> Element:
        return self._family.SCALARS["add"](self._builder, self.dtype, x, y)

    def _sum(self, factors: Sequence[Element]) -> Element:
        """Computes a sum of many products from several partial sums, which a processor adds at once."""
        numbers = list(map(self._multiply, factors[::2], factors[1::2]))
        constants, variables = [x for x in numbers if is_known(x)], [x for x in numbers if not is_known(x)]
        if variables:  # to which a known 0 adds nothing; only the sign of a sum that is 0 may be another
            constants = [x for x in constants if x != 0]
        apart = PARTIAL_SUMS if len(variables) >= 2 * PARTIAL_SUMS else 1
        sums = [functools.reduce(self._add, variables[first::apart]) for first in range(apart) if variables]
        sums += [functools.reduce(self._add, constants)] if constants else []
        while len(sums) > 1:
            sums = [self._add(*sums[k : k + 2]) if k + 1 < len(sums) else sums[k] for k in range(0, len(sums), 2)]
        return sums[0]
