"""Sorting: by merging (von Neumann, 1945), which is stable."""

import numpy as np

from ...ir.elements import Element, Index
from ...ir.program import Operation
from ...limits import LANES
from ..builder import INDEX
from ..instructions import BOOL
from ..lowering import Function
from ..rules import rule
from ..scalars import complex, real
from ..values import Array, Memory


@rule("stablehlo.sort")
def sort(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """Sorts arrays along one dimension into the order in which the region says which element comes before which."""
    storage, dimension = function.storage, operation.attribute("dimension")
    shape = operands[0].shape
    sources = [storage.anywhere(storage.evaluate(array)) for array in operands]
    varying = any(array.varying for array in sources)
    targets = [storage.allocate(shape, array.dtype, varying) for array in operands]
    length = shape[dimension]
    rows = [[storage.allocate((length,), array.dtype, varying) for array in operands] for _ in range(2)]
    with storage.every_index([1 if k == dimension else n for k, n in enumerate(shape)]) as place:

        def index(i: Index) -> list[Index]:
            return [i if k == dimension else j for k, j in enumerate(place)]

        for row, source in zip(rows[0], sources, strict=True):
            with storage.every_index((length,)) as (i,):
                storage.put(row, (i,), source.element(function.builder, index(i)))
        _sort(function, operation, length, *rows)
        for row, target in zip(rows[0], targets, strict=True):
            with storage.every_index((length,)) as (i,):
                storage.put(target, index(i), row.element(function.builder, (i,)))
    return list(targets)


def _sort(function: Function, operation: Operation, length: int, rows: list[Memory], spare: list[Memory]) -> None:
    """Sorts rows: sorted parts of 1, 2, 4, … elements are merged two by two."""
    b, storage = function.builder, function.storage
    if length < 2:
        return
    comes_before = function.combination(operation.regions[0])

    def least(i: Index, j: Index) -> Index:
        return b.select(INDEX, b.apply("icmp slt", INDEX, i, j), i, j)

    with b.loop(0, (length - 1).bit_length()) as turn:
        part = b.pure(f"shl i64 1, {turn.index}")
        twice = b.plus(part, part)
        parts = b.pure(f"sdiv i64 {b.operand(INDEX, b.plus(twice, length - 1))}, {twice}")
        with b.loop(0, parts) as pair:
            start = b.times(pair.index, twice)
            middle, end = least(b.plus(start, part), length), least(b.plus(start, twice), length)
            varying = rows[0].varying
            firsts = [b.spread(INDEX, i) if varying else i for i in (start, middle)]
            with b.loop(start, end, *((INDEX, i) for i in firsts)) as slot:
                i, j = slot.carried
                first, second = ([row.element(b, (least(k, length - 1),)) for row in rows] for k in (i, j))
                later = comes_before(*(element for two in zip(second, first, strict=True) for element in two))[0]
                has_first, has_second = b.compare("slt", INDEX, i, middle), b.compare("slt", INDEX, j, end)
                # Of equal elements the first comes first, so that the sort is stable, as JAX asks for.
                takes_second = b.binary("and", BOOL, later, has_second)
                takes_second = b.binary("or", BOOL, takes_second, b.binary("xor", BOOL, has_first, np.bool_(True)))
                for row, x, y in zip(spare, second, first, strict=True):
                    storage.put(row, (slot.index,), _choose(function, row.dtype, takes_second, x, y))
                step = b.convert("zext", BOOL, INDEX, takes_second)
                slot.following = [b.plus(i, b.apply("sub", INDEX, 1, step)), b.plus(j, step)]
        # Copied back in each round, so that the loop over rounds has the same two memories in each.
        for row, other in zip(rows, spare, strict=True):
            b.copy(row.buffer.name, other.buffer.name, length * row.dtype.itemsize * (LANES if row.varying else 1))


def _choose(function: Function, dtype: np.dtype, condition: Element, x: Element, y: Element) -> Element:
    return (complex if dtype.kind == "c" else real).select(function.builder, dtype, condition, x, y)
