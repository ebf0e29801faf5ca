"""Custom calls outside StableHLO: library routines, and Python functions."""

import numpy as np

from ...ir.elements import UnsupportedError
from ...ir.program import Operation
from ..lowering import Function, is_callback
from ..rules import rule
from ..values import Array, Registers
from . import linear_algebra


@rule("stablehlo.custom_call")
def custom_call(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """A routine of LAPACK; a callback ends the program, which is then run by XLA."""
    if is_callback(operation):
        function.refuse()
        return [Registers(result.dtype, np.zeros(result.shape, result.dtype)) for result in operation.results]
    target = operation.attribute("call_target_name")
    routine = linear_algebra.routine_named(target)
    if routine is None:
        raise UnsupportedError(f"{operation.name} of {target}")
    return linear_algebra.solve(function, operation, operands, *routine)
