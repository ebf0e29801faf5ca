"""Finds the counters of loops, which tell how often a loop is turned and between which bounds its indices lie.

JAX lets a negative index count from the end, and StableHLO clamps slices that would reach over an end; for a counter
that runs from 0 to below the length of an array, neither happens, and neither is written.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .program import Block, Operation, Value


class Counter(NamedTuple):
    """An integer that a loop carries and that only grows.

    - ``step``: by how much in each turn.
    - ``limit``: what it is less than wherever the loop goes on, if that is a number of the program.
    - ``decides``: whether the loop goes on wherever it is less, so that nothing else ends the loop.
    """

    step: int
    limit: int | None
    decides: bool


def find_counters(operation: Operation) -> dict[int, Counter]:
    """Finds the counters of a ``stablehlo.while``, by their positions among what it carries."""
    condition, body = operation.regions
    makers, makers_in_condition = body.makers(), condition.makers()
    limits = dict(_limits(condition.results[0], condition, makers_in_condition))
    last = makers_in_condition.get(condition.results[0])
    counters = {}
    for position, (argument, result) in enumerate(zip(body.arguments, body.results, strict=True)):
        following = makers.get(result)
        if argument.shape or argument.dtype.kind not in "iu" or following is None:
            continue
        # As JAX writes it, with the step second.
        if following.name != "stablehlo.add" or following.operands[0] is not argument:
            continue
        step, counter = constant_of(makers, following.operands[1]), condition.arguments[position]
        if step is None or step <= 0:
            continue
        limit = limits.get(counter)
        if limit is not None and limit + step - 1 > np.iinfo(argument.dtype).max:
            limit = None  # it might pass the last integer and go on with the first
        # Only if the condition is this comparison alone: of several, joined by and, another one may end the loop.
        decides = counter in limits and last is not None and last.operands[0] is counter
        counters[position] = Counter(step, limit, decides)
    return counters


def constant_of(makers: dict[Value, Operation], value: Value) -> int | None:
    """Returns the integer or boolean that all elements of a value are, if a constant of the program says so.

    - ``makers``: of the block in which the value is made.
    """
    operation = makers.get(value)
    while operation is not None and operation.name == "stablehlo.broadcast_in_dim":
        operation = makers.get(operation.operands[0])
    if operation is None or operation.name != "stablehlo.constant" or operation.results[0].dtype.kind not in "iub":
        return None
    numbers = operation.constant()
    return int(numbers.flat[0]) if numbers.size and np.all(numbers == numbers.flat[0]) else None


def _limits(value: Value, block: Block, makers: dict[Value, Operation]) -> Iterator[tuple[Value, int]]:
    """Finds the arguments of a block with what they are less than, wherever a value of it is true."""
    operation = makers.get(value)
    if operation is None:
        return
    operands, name = operation.operands, operation.name
    if name == "stablehlo.and":
        yield from _limits(operands[0], block, makers)
        yield from _limits(operands[1], block, makers)
    # These leave a single truth value what it is.
    elif (name == "stablehlo.convert" and operands[0].dtype.kind == "b") or (
        name == "stablehlo.reduce" and not operation.attribute("dimensions")
    ):
        yield from _limits(operands[0], block, makers)
    elif name == "stablehlo.compare" and operation.attribute("comparison_direction") == "NE":
        if operands[0].dtype.kind == "b" and constant_of(makers, operands[1]) == 0:
            yield from _limits(operands[0], block, makers)
    elif name == "stablehlo.compare" and operation.attribute("comparison_direction") == "LT":
        limit = constant_of(makers, operands[1])
        if operands[0] in block.arguments and limit is not None:
            yield operands[0], limit
