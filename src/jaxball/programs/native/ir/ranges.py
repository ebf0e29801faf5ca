"""Bounds of loop counters, with which checks against other values can be omitted.

JAX lets a negative index count from the end, and StableHLO clamps slices that would reach over an end; for a counter
that runs from 0 to below the length of an array, neither happens.
"""

from collections.abc import Iterator

import numpy as np

from .program import Block, Operation, Value


def find_counters(operation: Operation) -> dict[int, tuple[int, int | None]]:
    """Of a ``stablehlo.while``, by position, each integer that only grows: by how much a turn, and below what."""
    condition, body = operation.regions
    made, limits = _makers(body), dict(_below(condition.results[0], condition, _makers(condition)))
    counters = {}
    for position, (argument, result) in enumerate(zip(body.arguments, body.results, strict=True)):
        following = made.get(result)
        if argument.shape or argument.dtype.kind != "i" or following is None or following.name != "stablehlo.add":
            continue
        step = _constant(made, following.operands[1])
        if following.operands[0] is argument and step is not None and step > 0:
            counters[position] = step, limits.get(condition.arguments[position])
    return counters


def _makers(block: Block) -> dict[Value, Operation]:
    return {result: operation for operation in block.operations for result in operation.results}


def _constant(made: dict[Value, Operation], value: Value) -> int | None:
    """The integer or boolean that all elements of a value are."""
    operation = made.get(value)
    while operation is not None and operation.name == "stablehlo.broadcast_in_dim":
        operation = made.get(operation.operands[0])
    if operation is None or operation.name != "stablehlo.constant" or operation.results[0].dtype.kind not in "ib":
        return None
    numbers = operation.constant()
    return int(numbers.flat[0]) if numbers.size and np.all(numbers == numbers.flat[0]) else None


def _below(value: Value, block: Block, made: dict[Value, Operation]) -> Iterator[tuple[Value, int]]:
    """Arguments of a block with what they are less than, wherever a value of it is true."""
    operation = made.get(value)
    if operation is None:
        return
    operands, name = operation.operands, operation.name
    if name == "stablehlo.and":
        yield from _below(operands[0], block, made)
        yield from _below(operands[1], block, made)
    elif (name == "stablehlo.convert" and operands[0].dtype.kind == "b") or (
        name == "stablehlo.reduce" and not operation.attribute("dimensions")
    ):
        yield from _below(operands[0], block, made)
    elif name == "stablehlo.compare" and operation.attribute("comparison_direction") == "NE":
        if operands[0].dtype.kind == "b" and _constant(made, operands[1]) == 0:
            yield from _below(operands[0], block, made)
    elif name == "stablehlo.compare" and operation.attribute("comparison_direction") == "LT":
        limit = _constant(made, operands[1])
        if operands[0] in block.arguments and limit is not None:
            yield operands[0], limit
