"""How small arrays are passed on in registers: to a loop's next turn, from branches, to a function and back.

The rules of loops and branches, and the signatures of functions, ask here; larger arrays are passed on in memory.
"""

import copy
from collections.abc import Sequence

import numpy as np

from ..ir.elements import Element
from .lowering import Function
from .storage import join_parts, parts, parts_of
from .values import Array, Registers, registers, size_of
from .vectors import are_handed_on, in_vectors, number_of_vectors, one_by_one


class Passing:
    """How an array is passed on: number by number, the parts of complex ones apart, or in vectors along its first axis.

    - ``varying``: whether each lane of a loop has an array of its own; then each number is a vector.
    - ``stacked``: whether it is in vectors along its first axis, which otherwise would be taken apart and made again.
    - ``kinds``: the types of the registers, and whether they are vectors.
    """

    def __init__(self, function: Function, shape: tuple[int, ...], dtype: np.dtype, varying: bool = False):
        self.function, self.shape, self.dtype, self.varying = function, shape, dtype, varying
        self.stacked = function.uses_vectors and are_handed_on(shape, dtype)
        self.kinds = [(kind, varying) for kind in parts_of(dtype, size_of(shape))]
        # Phis of single numbers would make LLVM take the vectors apart in every turn.
        if self.stacked:
            self.kinds = [(dtype, True)] * number_of_vectors(shape)

    def within(self, function: Function) -> "Passing":
        """Returns the same for another function, one that is called, where the numbers that it reads and returns are
        written.
        """
        other = copy.copy(self)
        other.function = function
        return other

    def split(self, array: Array) -> list[Element]:
        """Returns the numbers of the registers. Where lanes have each their own, a single one may stand for all."""
        flat = list(self.function.storage.to_registers(array).objects().reshape(-1))
        if self.stacked:
            return in_vectors(self.function.builder, self.dtype, self.shape, flat)
        return [number for _, number in parts([self.dtype] * len(flat), flat)]

    def spread(self, array: Array) -> list[Element]:
        """Returns the numbers of the registers, each a vector where lanes have each their own."""
        spread, numbers = self.function.builder.spread, self.split(array)
        return [spread(kind, x) if wide else x for (kind, wide), x in zip(self.kinds, numbers, strict=True)]

    def join(self, numbers: Sequence[Element]) -> Registers:
        """Returns the array of these numbers."""
        if self.stacked:
            numbers = one_by_one(self.function.builder, self.dtype, self.shape, numbers)
        return registers(self.dtype, join_parts([self.dtype] * size_of(self.shape), numbers), self.shape)
