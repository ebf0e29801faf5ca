"""Operations that contain programs: loops, branches, and calls of functions."""

import contextlib
from collections.abc import Iterator, Sequence

import numpy as np

from ...ir.counters import find_counters
from ...ir.elements import Element, Vector, vector_type
from ...ir.lanes import Independent, independent
from ...ir.program import Block, Operation
from ...limits import LANES, MOST_NUMBERS, MOST_TURNS, MOST_UNCHANGED
from .. import uninitialised
from ..builder import BOOL, INDEX
from ..functions import call_function
from ..lowering import Function
from ..rules import rule
from ..storage import join_parts, parts, parts_of
from ..values import Array, Memory, Registers, is_small, registers, size_of
from ..vectors import are_handed_on, in_vectors, number_of_vectors, one_by_one

_OF_CONDITIONS = {
    f"stablehlo.{name}" for name in ("and", "broadcast_in_dim", "compare", "constant", "convert", "reduce")
}


@rule("func.call")
def call(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """A function's operations in the place of the call, or a call, where they are many and called again."""
    name = operation.attribute("callee")
    block = function.compiler.functions[name]
    if name.startswith(uninitialised.NAME):
        return [function.storage.allocate(value.shape, value.dtype) for value in operation.results]
    if function.compiler.stays_function(name):
        return call_function(function, name, block, operands)
    for value in dict.fromkeys(operation.operands):
        function.hand_on(operation, value)
    with function.write_block(block, operands) as results:
        for array in results:  # theirs until they are the call's
            function.storage.pin(array, 1)
    for array in results:
        function.storage.pin(array, -1)
    return results


@rule("stablehlo.while")
def while_(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """The body's results are the next turn's arguments, for as long as the condition holds."""
    if not function.in_lanes:
        loop = independent(operation, [_read_integer(array) for array in operands], function.compiler.functions)
        if loop is not None and function.uses_vectors:
            return _in_lanes(function, operation, operands, loop)
        if loop is not None:
            function.compiler.longest_map = max(function.compiler.longest_map, loop.turns)
    turns = _few_turns(function, operation, operands)
    if turns is not None:
        return _write_turns(function, operation, operands, turns)
    b, storage = function.builder, function.storage
    condition, body = operation.regions
    apart, varying = False, [False] * len(operands)
    if function.in_lanes:
        apart, varying = function.varying().loop(operation, [array.varying for array in operands])
    carries = [
        _Carry(function, operation, position, array, varying[position]) for position, array in enumerate(operands)
    ]
    before, header, inside, after = (b.label, *(b.new_label(name) for name in ("while", "body", "done")))
    with b.write_loop(), b.scope():
        b.jump(header)
        b.begin(header)
        cost = b.cost
        for carry in carries:
            carry.begin()
        counters = {} if function.in_lanes else find_counters(operation)
        counters = {position: counter for position, counter in counters.items() if carries[position].phis}
        for position in counters:
            carries[position].note_limit(None)
        for carry in carries:
            carry.lend(1)  # the condition overwrites nothing
        with function.write_block(condition, [carry.array for carry in carries]) as (holds,):
            goes_on = storage.to_registers(holds).element(b, ())
        for carry in carries:
            carry.lend(-1)
        with contextlib.ExitStack() as stack:
            going = stack.enter_context(b.mask_writes(b.spread(BOOL, goes_on))) if apart else None
            b.branch(goes_on if going is None else b.any_lane(going), inside, after)
            stack.enter_context(b.scope())
            b.begin(inside)
            for position, (_, limit, _) in counters.items():
                carries[position].note_limit(limit)
            with function.write_block(body, [carry.array for carry in carries]) as results:
                in_memory = [
                    (carry.array, result)
                    for carry, result in zip(carries, results, strict=True)
                    if carry.in_memory and isinstance(carry.array, Memory)
                ]
                following = [
                    carry.following(result, going) if carry.phis else []
                    for carry, result in zip(carries, results, strict=True)
                ]
                storage.move([target for target, _ in in_memory], [source for _, source in in_memory])
            function.looks_for_signals(b.cost - cost)
            for carry, numbers in zip(carries, following, strict=True):
                carry.end(before, numbers)
            b.jump(header)
    b.begin(after)
    for position, (step, limit, _) in counters.items():
        carries[position].note_limit(None if limit is None else limit + step)
    for carry in carries:
        carry.release()
    return [carry.array for carry in carries]


def _read_integer(array: Array) -> int | None:
    """The single integer that an array is."""
    if not isinstance(array, Registers) or not array.known or array.elements.size != 1 or array.dtype.kind not in "iu":
        return None
    return int(array.elements.reshape(-1)[0])


def _few_turns(function: Function, operation: Operation, operands: list[Array]) -> int | None:
    """How many turns a loop has that counts from a known number to a known one, and is short enough to be written out.

    Then indices are known, and what the loop fills need not be in memory.
    """
    numbers, counters = [_read_integer(array) for array in operands], find_counters(operation)
    ends = [
        -(-(limit - number) // step)
        for position, (step, limit, _) in counters.items()
        if limit is not None and (number := numbers[position]) is not None
    ]
    condition, body = operation.regions
    facts = sum(
        inner.name == "stablehlo.compare" and inner.operands[0].dtype.kind != "b" for inner in condition.operations
    )
    if not ends or len(ends) != facts or any(inner.name not in _OF_CONDITIONS for inner in condition.operations):
        return None
    operations = list(_operations_within(function, body))
    if any(inner.name == "stablehlo.gather" for inner in operations):
        return None  # by indices that operations compute, as the rows of pivots, which stay in memory
    size = sum(result.size for inner in operations for result in inner.results)
    turns = max(min(ends), 0)
    return turns if 0 < turns <= MOST_TURNS and turns * size <= MOST_NUMBERS else None


def _operations_within(function: Function, block: Block) -> Iterator[Operation]:
    """The operations of a block, with those of the functions that are written where it calls them."""
    for operation in block.every_operation():
        yield operation
        if operation.name == "func.call" and not function.compiler.stays_function(operation.attribute("callee")):
            yield from _operations_within(function, function.compiler.functions[operation.attribute("callee")])


def _write_turns(function: Function, operation: Operation, operands: list[Array], turns: int) -> list[Array]:
    """One turn after another."""
    storage, arrays = function.storage, [function.storage.settle(array) for array in operands]
    for array in arrays:
        storage.pin(array, 1)
    for _ in range(turns):
        with function.write_block(operation.regions[1], arrays) as results:
            results = [storage.settle(array) for array in results]
            for array in results:  # theirs until they are the next turn's
                storage.pin(array, 1)
        for array in arrays:
            storage.pin(array, -1)
        arrays = results
    for array in arrays:
        storage.pin(array, -1)
    return [*arrays]


def _in_lanes(function: Function, operation: Operation, operands: list[Array], loop: Independent) -> list[Array]:
    """As many turns at a time as a vector has lanes; in the last ones some are computed again."""
    b, storage = function.builder, function.storage
    _, body = operation.regions
    arrays: list[Array] = []
    for position, array in enumerate(operands):
        if position in loop.written:
            array = function.overwritable(operation, position, array)
            array.buffer.shared = True
        elif position != loop.counter:
            array = storage.settle(array)
        storage.pin(array, 1)
        arrays.append(array)
    cost = b.cost
    with b.loop(0, -(-loop.turns // LANES)) as turn:
        dtype = operands[loop.counter].dtype
        numbers = ", ".join(f"i64 {lane}" for lane in range(LANES))
        first = b.spread(INDEX, b.times(turn.index, LANES))
        index = b.clamp(Vector(b.pure(f"add nuw nsw {vector_type(INDEX)} {first}, <{numbers}>", True)), loop.turns - 1)
        if dtype.itemsize < INDEX.itemsize:
            index = Vector(b.convert("trunc", INDEX, dtype, index))
        given = [*arrays]
        given[loop.counter] = registers(dtype, [index], ())
        function.in_lanes = True
        with function.write_block(body, given):
            pass
        function.in_lanes = False
        function.looks_for_signals(b.cost - cost)
    for position, array in enumerate(arrays):
        storage.pin(array, -1)
        if position in loop.written:
            array.buffers[0].shared = False
    arrays[loop.counter] = Registers(dtype, np.array(loop.turns, dtype))
    return arrays


def _with_twin(function: Function, array: Array) -> Registers:
    """The numbers of an array in registers, and in memory as well where they are there."""
    numbers = function.storage.to_registers(array)
    if isinstance(array, Memory):
        numbers.twin, numbers.buffers = array, array.buffers
    return numbers


class _Carry:
    """One array that a loop carries from turn to turn: unchanged, in memory, or in registers.

    ``varying``: whether lanes have each their own.
    """

    def __init__(self, function: Function, operation: Operation, position: int, array: Array, varying: bool):
        self.function, self.varying = function, varying
        condition, body = operation.regions
        arguments = condition.arguments[position], body.arguments[position]
        self.unchanged = body.results[position] is body.arguments[position]
        most = MOST_UNCHANGED if self.unchanged else 0
        small = all(function.compiler.in_registers(value, most) for value in arguments) or not arguments[0].size
        self.in_memory = not self.unchanged and not small
        self.phis: list[tuple[int, np.dtype, str]] = []
        self.in_vectors = False
        self.owners = 0
        storage = function.storage
        if self.unchanged:
            self.array = _with_twin(function, array) if small else storage.anywhere(storage.settle(array))
        elif small:
            self.array = storage.to_registers(array)
            self.in_vectors = function.uses_vectors and are_handed_on(self.array.shape, self.array.dtype)
            self.first = self._hand_on(self.array)
        else:
            self.array = function.overwritable(operation, position, array, varying)
        if self.in_memory:
            buffer = self.array.buffers[0]
            self.owners, buffer.owners = buffer.owners, 0
        storage.pin(self.array, 1)

    def begin(self) -> None:
        """Writes what begins a turn."""
        if self.unchanged or self.in_memory or not isinstance(self.array, Registers):
            return
        b, dtype, shape = self.function.builder, self.array.dtype, self.array.shape
        count = number_of_vectors(shape) if self.in_vectors else size_of(shape)
        names = []
        for kind in parts_of(dtype, count):
            names.append(b.fresh(self.varying or self.in_vectors))
            self.phis.append((b.reserve(), kind, names[-1]))
        numbers = one_by_one(b, dtype, shape, names) if self.in_vectors else join_parts([dtype] * count, names)
        self.array = registers(dtype, numbers, shape)

    def _hand_on(self, array: Array) -> list[Element]:
        numbers = _numbers(self.function, array, self.varying)
        return in_vectors(self.function.builder, array.dtype, array.shape, numbers) if self.in_vectors else numbers

    def following(self, array: Array, going: Element | None) -> list[Element]:
        """The numbers with which the next turn begins: where lanes have left the loop, those they left with."""
        b = self.function.builder
        numbers = [
            b.like(kind, number, name) for number, (_, kind, name) in zip(self._hand_on(array), self.phis, strict=True)
        ]
        if going is None:
            return numbers
        return [b.select(kind, going, number, name) for number, (_, kind, name) in zip(numbers, self.phis, strict=True)]

    def end(self, before: str, following: Sequence[Element]) -> None:
        """Writes, at the beginning of a turn, what the last one gave."""
        b = self.function.builder
        for (place, dtype, name), first, new in zip(self.phis, self.first if self.phis else [], following, strict=True):
            b.fill_phi(place, name, dtype, [(first, before), (new, b.label)])

    def note_limit(self, limit: int | None) -> None:
        """Notes that an integer, which only grows, is less than a limit."""
        b, first = self.function.builder, self.function.builder.range_of(self.first[0])
        ((_, _, name),) = self.phis
        # A counter that has no limit might come to the last integer and go on with the first.
        b.note_bounds(name, None if first is None or limit is None else (first[0], max(limit - 1, first[1])))

    def lend(self, count: int) -> None:
        if self.in_memory:
            self.array.buffers[0].owners += count

    def release(self) -> None:
        self.function.storage.pin(self.array, -1)
        if self.in_memory:
            self.array.buffers[0].owners = self.owners


@rule("stablehlo.case", "stablehlo.if")
def case(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """One of several regions: by number, of which those out of range mean the last; or by a condition."""
    b, storage = function.builder, function.storage
    chosen = storage.to_registers(operands[0]).element(b, ())
    regions, after = operation.regions, b.new_label("after")
    if isinstance(chosen, Vector):
        return _each_way(function, operation, chosen)
    labels = [b.new_label("case") for _ in regions]
    if operation.name == "stablehlo.if":
        b.branch(chosen, *labels)
    else:
        kind = operands[0].dtype
        ways = " ".join(f"i32 {k}, label %{label}" for k, label in enumerate(labels[:-1]))
        number = b.as_index(chosen, kind)
        number = number if isinstance(number, int) else chosen
        b.write(f"switch i32 {b.operand(kind, number)}, label %{labels[-1]} [ {ways} ]")
    branches = _Branches(function, operation)
    for label, region in zip(labels, regions, strict=True):
        b.begin(label)
        with b.scope():
            branches.write(region)
            b.jump(after)
    b.begin(after)
    return branches.results()


class _Branches:
    """The results of branches: phis of registers, and memory that each branch fills."""

    def __init__(self, function: Function, operation: Operation):
        self.function, self.operation = function, operation
        self.small = [is_small(value.shape) for value in operation.results]
        self.in_vectors = [
            function.uses_vectors and are_handed_on(value.shape, value.dtype) for value in operation.results
        ]
        self.varying = [False] * len(self.small)
        if function.in_lanes:
            self.varying = function.varying().branches(operation, False)
        self.targets: list[Memory | None] = [None] * len(self.small)
        self.cases: list[list[tuple[list[Element], str]]] = [[] for _ in self.small]
        self.given = _Given(function, operation)

    def write(self, region: Block) -> None:
        """Writes one branch."""
        function, storage = self.function, self.function.storage
        mark = storage.mark()
        with function.write_block(region, []) as results:
            for position, array in enumerate(results):
                if self.small[position]:
                    numbers = _numbers(function, array, self.varying[position])
                    if self.in_vectors[position]:
                        numbers = in_vectors(function.builder, array.dtype, array.shape, numbers)
                    self.cases[position].append((numbers, ""))
                elif self.targets[position] is None:
                    self._choose_target(position, region, array)
            moves = [(target, array) for target, array in zip(self.targets, results, strict=True) if target is not None]
            storage.move([target for target, _ in moves], [array for _, array in moves])
            for position, small in enumerate(self.small):
                if small:
                    numbers, _ = self.cases[position][-1]
                    self.cases[position][-1] = numbers, function.builder.label
        self.given.bring_back()
        storage.sweep(mark)

    def _choose_target(self, position: int, region: Block, array: Array) -> None:
        """The memory of a result: where the first branch has it already, if that is only its own.

        What a branch hands on as it was given it is its own if nobody reads that after the branches.
        """
        value, taken = region.results[position], {target.buffer.name for target in self.targets if target is not None}
        own = isinstance(array, Memory) and array.buffer.writable and array.buffer.owners == 1
        own &= value.block is region or value in self.given.arrays
        same = array.varying == self.varying[position]
        if not isinstance(array, Memory) or not own or not same or array.buffer.name in taken:
            array = self.function.storage.allocate(array.shape, array.dtype, self.varying[position])
        self.function.storage.pin(array, 1)
        self.targets[position] = array

    def results(self) -> list[Array]:
        """The results, after all branches."""
        storage, b = self.function.storage, self.function.builder
        self.given.give_up()
        results: list[Array] = []
        columns = zip(self.operation.results, self.targets, self.cases, self.in_vectors, strict=True)
        for value, target, cases, wide in columns:
            if target is not None:
                storage.pin(target, -1)
                results.append(target)
                continue
            kinds = [value.dtype] * len(cases[0][0]) if wide else parts_of(value.dtype, value.size)
            labels = [label for _, label in cases]
            numbers = [
                b.phi(kind, list(zip(ways, labels, strict=True)))
                for kind, *ways in zip(kinds, *(numbers for numbers, _ in cases), strict=True)
            ]
            if wide:
                numbers = one_by_one(b, value.dtype, value.shape, numbers)
            results.append(registers(value.dtype, join_parts([value.dtype] * value.size, numbers), value.shape))
        return results


class _Given:
    """What no one reads after an operation with branches.

    It may be overwritten in each of the branches, each time as if that were the only one.
    """

    def __init__(self, function: Function, operation: Operation):
        self.function = function
        self.arrays = {value: function.values[value] for value in operation.last if value in function.values}
        self.owners = [(buffer, buffer.owners) for array in self.arrays.values() for buffer in array.buffers]
        for array in self.arrays.values():
            function.storage.pin(array, 1)

    def bring_back(self) -> None:
        """After a branch, all is as before it."""
        self.function.values.update(self.arrays)
        for buffer, owners in self.owners:
            buffer.owners = owners

    def give_up(self) -> None:
        """After all branches."""
        for array in self.arrays.values():
            self.function.storage.pin(array, -1)


def _each_way(function: Function, operation: Operation, chosen: Vector) -> list[Array]:
    """Each region in the lanes that go its way, if there are any."""
    b, storage = function.builder, function.storage
    targets = [
        None if is_small(value.shape) else storage.allocate(value.shape, value.dtype, True)
        for value in operation.results
    ]
    for target in targets:
        if target is not None:
            storage.pin(target, 1)
    small = [value for value in operation.results if is_small(value.shape)]
    kinds = [kind for value in small for kind in parts_of(value.dtype, value.size)]
    numbers: list[Element] = [b.spread(kind, kind.type(0)) for kind in kinds]
    given = _Given(function, operation)
    for condition, region in zip(_ways(function, operation, chosen), operation.regions, strict=True):
        with b.mask_writes(condition) as going:
            before, inside, after = b.label, b.new_label("some"), b.new_label("after")
            b.branch(b.any_lane(going), inside, after)
            b.begin(inside)
            mark = storage.mark()
            with b.scope():
                with function.write_block(region, []) as results:
                    new = [
                        number
                        for array, target in zip(results, targets, strict=True)
                        if target is None
                        for number in _numbers(function, array, True)
                    ]
                    new = [b.select(kind, going, x, y) for kind, x, y in zip(kinds, new, numbers, strict=True)]
                    moves = [(target, array) for target, array in zip(targets, results, strict=True) if target]
                    storage.move([target for target, _ in moves], [array for _, array in moves])
                given.bring_back()
                storage.sweep(mark)
                last = b.label
                b.jump(after)
            b.begin(after)
            numbers = [b.phi(kind, [(y, before), (x, last)]) for kind, x, y in zip(kinds, new, numbers, strict=True)]
    given.give_up()
    rest, results = iter(numbers), []
    for value, target in zip(operation.results, targets, strict=True):
        if target is not None:
            storage.pin(target, -1)
            results.append(target)
            continue
        own = [next(rest) for _ in parts_of(value.dtype, value.size)]
        results.append(registers(value.dtype, join_parts([value.dtype] * value.size, own), value.shape))
    return results


def _ways(function: Function, operation: Operation, chosen: Vector) -> list[Vector]:
    """In which lanes each region is executed."""
    b, dtype = function.builder, operation.operands[0].dtype
    if operation.name == "stablehlo.if":
        return [chosen, Vector(b.binary("xor", BOOL, chosen, np.bool_(True)))]
    ways = [Vector(b.compare("eq", dtype, chosen, dtype.type(k))) for k in range(len(operation.regions) - 1)]
    none: Element = b.spread(BOOL, np.bool_(True))
    for way in ways:
        none = b.binary("and", BOOL, none, b.binary("xor", BOOL, way, np.bool_(True)))
    return [*ways, Vector(none)]


def _numbers(function: Function, array: Array, varying: bool) -> list[Element]:
    """The numbers of an array one by one, those of complex ones by two; ``varying``: as vectors."""
    flat = list(function.storage.to_registers(array).objects().reshape(-1))
    spread = function.builder.spread
    return [spread(kind, x) if varying else x for kind, x in parts([array.dtype] * len(flat), flat)]
