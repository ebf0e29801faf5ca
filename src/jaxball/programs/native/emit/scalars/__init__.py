"""Functions of single numbers; those that an elementwise operation of StableHLO applies to each element.

The elementwise rules and the compiler of short regions ask here; ``real`` and ``complex`` write the instructions.
"""

from collections.abc import Callable

from ...ir.elements import Element, UnsupportedError
from ...ir.program import Operation
from . import complex, real


def scalar(operation: Operation) -> Callable[..., Element]:
    """Returns the function that an operation computes of single numbers; its arguments are the builder and these
    numbers.

    **Raises:** ``UnsupportedError`` for an operation that is not elementwise or is not known.
    """
    name, dtype, to = operation.short_name, operation.operands[0].dtype, operation.results[0].dtype
    if name == "convert":
        # Either type may be complex: to a real one, only the real part is converted.
        conversion = complex.convert if "c" in (dtype.kind, to.kind) else real.convert
        return lambda builder, x: conversion(builder, dtype, to, x)
    if name == "bitcast_convert":
        return lambda builder, x: real.bitcast(builder, dtype, to, x)
    family = complex if dtype.kind == "c" else real
    if name == "compare":
        total = operation.has("compare_type") and operation.attribute("compare_type") == "TOTALORDER"
        compute = family.comparison(operation.attribute("comparison_direction"), total)
    elif name in family.SCALARS:
        compute = family.SCALARS[name]
    else:
        raise UnsupportedError(f"{operation.name} of {dtype}")
    return lambda builder, *operands: compute(builder, dtype, *operands)


ELEMENTWISE = sorted({*real.SCALARS, *complex.SCALARS, "convert", "compare", "bitcast_convert"})
