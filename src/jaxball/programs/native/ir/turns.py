"""Turns of a loop: how many there are, whether they are independent, and what differs between them.

The counter of a loop tells how often it is turned, and between which bounds its indices lie. JAX lets a negative index
count from the end, and StableHLO clamps slices that would reach over an end; for a counter that runs from 0 to below
the length of an array, neither happens, and neither is written.

The turns of a ``jax.lax.map`` are independent: turn i reads element i of arrays, and writes element i of others.
Several of them can be computed side by side, one in each lane of vectors; values that are the same in all of them stay
single numbers.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..limits import FEWEST, LANES, LEAST_WORK
from .program import Block, Operation, Value

# Of functions that are written for lanes alone: the name begins so, and a loop that calls one is in lanes however
# seldom it turns.
FOR_LANES = "jaxball_for_lanes"

_MOVING = ("stablehlo.dynamic_slice", "stablehlo.dynamic_update_slice", "stablehlo.gather")
_ARITHMETIC = frozenset(
    f"{dialect}.{name}"
    for dialect, names in {
        "stablehlo": (
            "add subtract multiply divide maximum minimum power atan2 sqrt rsqrt cbrt sine cosine tan tanh exponential "
            "exponential_minus_one log log_plus_one logistic dot_general reduce"
        ),
        "chlo": "asin acos atan sinh cosh asinh acosh atanh erf erfc erf_inv lgamma digamma",
    }.items()
    for name in names.split()
)
# Operations whose rules know no vectors.
_APART = ("stablehlo.custom_call", "stablehlo.select_and_scatter")


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


class Independent:
    """A loop whose turns are independent.

    - ``turns``: how many; ``counter``: the position of the loop's index among what it carries.
    - ``written``: positions of the arrays of which each turn writes an element, nothing else, and reads none.
    """

    def __init__(self, turns: int, counter: int, written: frozenset[int]):
        self.turns, self.counter, self.written = turns, counter, written


def independent(
    operation: Operation, start: Sequence[int | None], functions: Mapping[str, Block]
) -> Independent | None:
    """Describes a ``stablehlo.while`` whose turns are independent; None for another.

    - ``start``: the numbers with which the loop begins, where they are single and known.
    """
    condition, body = operation.regions
    # JAX counts the turns of a map from 0, one by one, and nothing else ends it.
    counters = find_counters(operation).items()
    counts = [(position, turns) for position, (step, turns, decides) in counters if decides and step == 1]
    counter, turns = counts[0] if counts else (0, None)
    if turns is None or start[counter] != 0 or _is_apart(body, functions):
        return None
    if turns < FEWEST * LANES and not _calls_for_lanes(body, functions):
        return None
    # Lanes pay for arithmetic only.
    moved, computed = _work(body, functions)
    if computed < LEAST_WORK * moved:
        return None
    written = frozenset(
        position
        for position, (argument, result) in enumerate(zip(body.arguments, body.results, strict=True))
        if result is not argument and position != counter
    )
    reads, of_condition = body.reads_within(), condition.reads_within()
    for position in written:
        argument, result = body.arguments[position], body.results[position]
        # Read once means: by the update itself. Then no turn sees what another one wrote.
        if reads.get(argument) != 1 or not _is_written_at(result, argument, body.arguments[counter], body, functions):
            return None
        # The condition would see some turns' elements before others are computed.
        if condition.arguments[position] in of_condition:
            return None
    return Independent(turns, counter, written) if written else None


def _calls_for_lanes(block: Block, functions: Mapping[str, Block]) -> bool:
    """Returns whether a block calls a function that is to be written once, for lanes, however often it is called."""
    calls = [operation.attribute("callee") for operation in block.every_operation() if operation.name == "func.call"]
    return any(name.startswith(FOR_LANES) or _calls_for_lanes(functions[name], functions) for name in calls)


def _work(block: Block, functions: Mapping[str, Block]) -> tuple[int, int]:
    """Counts the numbers that a block moves to or from where an index says, and the floats that it computes."""
    moved = computed = 0
    for operation in block.every_operation():
        if operation.name in _MOVING:
            moved += operation.operands[1].size if "update" in operation.name else operation.results[0].size
        elif operation.name in _ARITHMETIC and operation.operands[0].dtype.kind in "fc":
            computed += max(value.size for value in (operation.operands[0], *operation.results))
        elif operation.name == "func.call":
            inner = _work(functions[operation.attribute("callee")], functions)
            moved, computed = moved + inner[0], computed + inner[1]
    return moved, computed


def _is_written_at(result: Value, array: Value, index: Value, block: Block, functions: Mapping[str, Block]) -> bool:
    """Returns whether a value is an array in which the element of an index, along the first dimension, was replaced."""
    makers = block.makers()
    operation = makers.get(result)
    if operation is None:
        return False
    if operation.name == "func.call":
        inner = functions[operation.attribute("callee")]
        arguments = dict(zip(operation.operands, inner.arguments, strict=True))
        if array not in arguments or index not in arguments:
            return False
        inner_result = inner.results[operation.results.index(result)]
        return _is_written_at(inner_result, arguments[array], arguments[index], inner, functions)
    if operation.name != "stablehlo.dynamic_update_slice" or operation.operands[0] is not array:
        return False
    # A whole row at the turn's own index, so that no two turns write to the same place.
    _, update, first, *others = operation.operands
    rest_is_whole = update.shape[1:] == array.shape[1:] and all(constant_of(makers, other) == 0 for other in others)
    return update.shape[0] == 1 and rest_is_whole and (first is index or _is_wrapped(makers, first, index))


def _is_wrapped(makers: dict[Value, Operation], value: Value, index: Value) -> bool:
    """Returns whether a value is an index as JAX writes it, i + n where i < 0."""
    select = makers.get(value)
    if select is None or select.name != "stablehlo.select" or select.operands[2] is not index:
        return False
    # Of a counter from 0 on the condition is false, so the select is the counter.
    below = makers.get(select.operands[0])
    if below is None or below.name != "stablehlo.compare" or below.operands[0] is not index:
        return False
    return below.attribute("comparison_direction") == "LT" and constant_of(makers, below.operands[1]) == 0


def _is_apart(block: Block, functions: Mapping[str, Block]) -> bool:
    return any(
        operation.name in _APART
        or (operation.name == "func.call" and _is_apart(functions[operation.attribute("callee")], functions))
        for operation in block.every_operation()
    )


class Varying:
    """Which values differ between lanes, found without writing anything.

    ``known``: whether a value that is computed already does.
    """

    def __init__(self, functions: Mapping[str, Block], known: Callable[[Value], bool]):
        self._functions, self._known = functions, known
        self._values: dict[Value, bool] = {}
        self._called: dict[tuple[str, tuple[bool, ...]], list[bool]] = {}

    def results(self, block: Block, arguments: Sequence[bool]) -> list[bool]:
        """Returns which results of a block differ between lanes, by its arguments."""
        self._values.update(zip(block.arguments, arguments, strict=True))
        for operation in block.operations:
            self._values.update(zip(operation.results, self._of(operation), strict=True))
        return [self._is(value) for value in block.results]

    def _is(self, value: Value) -> bool:
        if value not in self._values:
            self._values[value] = self._known(value)
        return self._values[value]

    def loop(self, operation: Operation, start: Sequence[bool]) -> tuple[bool, list[bool]]:
        """Returns whether lanes leave a ``stablehlo.while`` at different turns, and which carried values differ."""
        condition, body = operation.regions
        carried = list(start)
        while True:
            (apart,) = self.results(condition, carried)
            # A value that a turn leaves as it is does not differ because lanes leave at different turns.
            changed = [result is not argument for result, argument in zip(body.results, body.arguments, strict=True)]
            new = [
                before or after or (apart and changes)
                for before, after, changes in zip(carried, self.results(body, carried), changed, strict=True)
            ]
            if new == carried:
                return apart, carried
            # What follows from a value that varies does so in the next turn. None ceases to vary, so this ends.
            carried = new

    def branches(self, operation: Operation, chosen: bool) -> list[bool]:
        """Returns which results of a ``stablehlo.case`` or ``if`` differ between lanes, by whether lanes go different
        ways.
        """
        rows = [self.results(region, []) for region in operation.regions]
        return [chosen or any(column) for column in zip(*rows, strict=True)]

    def call(self, name: str, arguments: Sequence[bool]) -> list[bool]:
        """Returns which results of a function differ between lanes."""
        key = name, tuple(arguments)
        if key not in self._called:
            # With values of its own: elsewhere the same function is called with other arguments.
            self._called[key] = Varying(self._functions, self._known).results(self._functions[name], arguments)
        return self._called[key]

    def _of(self, operation: Operation) -> Sequence[bool]:
        operands = [self._is(value) for value in operation.operands]
        if operation.name == "stablehlo.while":
            return self.loop(operation, operands)[1]
        if operation.name in ("stablehlo.case", "stablehlo.if"):
            return self.branches(operation, operands[0])
        if operation.name == "func.call":
            return self.call(operation.attribute("callee"), operands)
        # A region's result may follow from what the region reads around it alone.
        captured = (self._is(value) for value in operation.reads if value not in operation.operands)
        return [any(operands) or any(captured)] * len(operation.results)
