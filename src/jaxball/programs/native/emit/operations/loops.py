"""Loops: in lanes where their turns are independent, written out where they are few, and otherwise loops of LLVM's."""

import contextlib
from collections.abc import Iterator, Sequence

import numpy as np

from ...ir.elements import Element, Name, Vector, vector_type
from ...ir.program import Block, Operation
from ...ir.turns import Independent, find_counters, independent
from ...limits import LANES, MOST_NUMBERS, MOST_TURNS, MOST_UNCHANGED
from ..buffers import OwnersBefore
from ..builder import INDEX
from ..functions import Passing
from ..instructions import BOOL
from ..lowering import Function, rule
from ..values import Array, Memory, Registers, registers

_OF_CONDITIONS = {
    f"stablehlo.{name}" for name in ("and", "broadcast_in_dim", "compare", "constant", "convert", "reduce")
}


@rule("stablehlo.while")
def while_(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """Writes a loop: the body's results are the next turn's arguments, for as long as the condition holds."""
    # Within a loop in lanes, one of its own could only be in vectors of vectors: it turns for all lanes at once.
    if not function.in_lanes:
        loop = independent(operation, [_read_integer(array) for array in operands], function.compiler.functions)
        if loop is not None and function.uses_vectors:
            return _in_lanes(function, operation, operands, loop)
        # A GPU would turn it in one thread: whoever compiles for it asks how long it is.
        if loop is not None:
            function.compiler.longest_map = max(function.compiler.longest_map, loop.turns)
    turns = _few_turns(function, operation, operands)
    if turns is not None:
        return _write_turns(function, operation, operands, turns)
    return _Loop(function, operation, operands).write()


class _Loop:
    """A loop of LLVM's in three parts.

    The header begins with the phis of arrays in registers, and decides whether there is another turn. The body
    computes that. The back edge says with what the next one begins, and jumps to the header. Arrays in memory are at
    the same place in every turn: they are carried without an instruction, once the body has moved them there.
    """

    def __init__(self, function: Function, operation: Operation, operands: list[Array]):
        self.function, self.condition, self.body = function, *operation.regions
        # In lanes, some may have left the loop where others go on: it is turned while any lane goes on.
        self.lanes_part, varying = False, [False] * len(operands)
        if function.in_lanes:
            self.lanes_part, varying = function.varying().loop(operation, [array.varying for array in operands])
        self.carries = [
            _Carry(function, operation, position, array, varying[position]) for position, array in enumerate(operands)
        ]
        b = function.builder
        self.before, self.header, self.inside, self.after = b.label, *map(b.new_label, ("while", "body", "done"))
        # Lanes that have left carry their last numbers into the body, where a counter then is at its limit, not below
        # it.
        self.counters = {} if function.in_lanes else find_counters(operation)

    def write(self) -> list[Array]:
        """Writes the loop; the arrays with which it ends."""
        b = self.function.builder
        with b.write_loop(), b.scope(), contextlib.ExitStack() as block:
            b.jump(self.header)
            b.begin(self.header)
            cost = b.cost
            going = self._write_header(block)
            following = self._write_body(going)
            self.function.looks_for_signals(b.cost - cost)
            self._write_back_edge(following)
        b.begin(self.after)
        for position, (step, limit, _) in self.counters.items():
            # The last turn began below the limit, and added one step.
            self.carries[position].note_limit(None if limit is None else limit + step)
        for carry in self.carries:
            carry.end()
        return [carry.array for carry in self.carries]

    def _write_header(self, block: contextlib.ExitStack) -> Vector | None:
        """Writes the phis and the condition, and begins the body; the lanes that go on, where they part.

        - ``block``: is left where the body ends.
        """
        b, storage = self.function.builder, self.function.storage
        for carry in self.carries:
            carry.begin_turn()
        # An array in memory, as the index of another operation may be, has no name whose bounds could be noted.
        self.counters = {
            position: counter for position, counter in self.counters.items() if self.carries[position].phis
        }
        in_memory = [carry.target for carry in self.carries if carry.target]
        for array in in_memory:  # the body will need the numbers that the condition reads
            storage.add_owner(array)
        with self.function.write_block(self.condition, [carry.array for carry in self.carries]) as (holds,):
            goes_on = storage.to_registers(holds).element(b, ())
        for array in in_memory:
            storage.drop_owner(array)
        going = block.enter_context(b.mask_writes(b.spread(BOOL, goes_on))) if self.lanes_part else None
        b.branch(goes_on if going is None else b.any_lane(going), self.inside, self.after)
        # What the body computes is unknown after the loop, and known to the back edge.
        block.enter_context(b.scope())
        b.begin(self.inside)
        return going

    def _write_body(self, going: Vector | None) -> list[list[Element]]:
        """Writes one turn; of each carried array the numbers in registers with which the next one begins."""
        # Only here: in the condition a counter may have reached its limit.
        for position, counter in self.counters.items():
            self.carries[position].note_limit(counter.limit)
        with self.function.write_block(self.body, [carry.array for carry in self.carries]) as results:
            rows = list(zip(self.carries, results, strict=True))
            # Before arrays move: results that are formulas read what lies in memory now.
            following = [carry.following(result, going) for carry, result in rows]
            self.function.storage.move([(carry.target, result) for carry, result in rows if carry.target])
        return following

    def _write_back_edge(self, following: Sequence[Sequence[Element]]) -> None:
        """Completes the phis, which could not be written before the numbers of the next turn had names."""
        for carry, numbers in zip(self.carries, following, strict=True):
            carry.fill_phis(self.before, numbers)
        self.function.builder.jump(self.header)


def _with_twin(function: Function, array: Array) -> Registers:
    """Returns the numbers of an array in registers, and in memory as well where they are there."""
    numbers = function.storage.to_registers(array)
    if isinstance(array, Memory):
        numbers.twin, numbers.buffers = array, array.buffers
    return numbers


class _Carry:
    """One array that a loop carries from turn to turn: unchanged, in memory, or in registers.

    - ``array``: where it is in the part of the loop that is being written, and at last behind the loop.
    - ``target``: the memory in which each turn leaves it, if it is in memory.
    - ``phis``: of its numbers in registers, the places of the lines in the text, the types and the names.
    """

    def __init__(self, function: Function, operation: Operation, position: int, array: Array, varying: bool):
        self.function = function
        condition, body = operation.regions
        arguments = condition.arguments[position], body.arguments[position]
        unchanged = body.results[position] is body.arguments[position]
        # Condition and body are given the same array. Where either indexes it by a number of the program, it must be in
        # memory for both.
        # What a loop only reads may be larger: it takes no phis, and LLVM spills it at worst.
        most = MOST_UNCHANGED if unchanged else 0
        small = all(function.compiler.in_registers(value, most) for value in arguments) or not arguments[0].size
        self.phis: list[tuple[int, np.dtype, Name]] = []
        self.first: list[Element] = []
        self.target: Memory | None = None
        self.passing: Passing | None = None
        storage = function.storage
        if unchanged:
            self.array = _with_twin(function, array) if small else storage.anywhere(storage.evaluate(array))
        elif small:
            self.array = storage.to_registers(array)
            self.passing = Passing(function, array.shape, array.dtype, varying)
            self.first = self.passing.spread(self.array)
        else:
            self.array = self.target = function.overwritable(operation, position, array, varying)
        # The operand is not read in the loop but as the body's argument, which thus is the only owner there.
        self.owners = OwnersBefore([self.target] if self.target else [])
        self.owners.clear()
        # Between two turns no value owns it, and its memory would be the next array's.
        storage.pin(self.array)

    def begin_turn(self) -> None:
        """Writes what begins a turn."""
        if self.passing is None:
            return
        b = self.function.builder
        for kind, wide in self.passing.kinds:
            name = b.fresh(wide)
            self.phis.append((b.reserve(), kind, name))
        self.array = self.passing.join([name for _, _, name in self.phis])

    def following(self, array: Array, going: Vector | None) -> list[Element]:
        """Returns the numbers with which the next turn begins: where lanes have left the loop, the numbers they left
        with.
        """
        if self.passing is None:
            return []
        b, numbers = self.function.builder, self.passing.spread(array)
        numbers = [b.like(kind, number, name) for number, (_, kind, name) in zip(numbers, self.phis, strict=True)]
        if going is None:
            return numbers
        return [b.select(kind, going, number, name) for number, (_, kind, name) in zip(numbers, self.phis, strict=True)]

    def fill_phis(self, before: str, following: Sequence[Element]) -> None:
        """Writes, at the beginning of a turn, what the last one gave, or what there was before the loop."""
        b = self.function.builder
        # The last turn need not end in the block in which it began.
        for (place, dtype, name), first, new in zip(self.phis, self.first, following, strict=True):
            b.fill_phi(place, name, dtype, [(first, before), (new, b.label)])

    def note_limit(self, limit: int | None) -> None:
        """Notes that an integer, which only grows, is less than a limit."""
        b, first = self.function.builder, self.function.builder.range_of(self.first[0])
        ((_, _, name),) = self.phis
        # A counter that has no limit might come to the last integer and go on with the first.
        b.note_bounds(name, None if first is None or limit is None else (first[0], max(limit - 1, first[1])))

    def end(self) -> None:
        """Leaves the array, behind the loop, to the values that own it there."""
        self.function.storage.unpin(self.array)
        self.owners.restore()


def _read_integer(array: Array) -> int | None:
    """Returns the single integer that an array is."""
    if not isinstance(array, Registers) or not array.known or array.elements.size != 1 or array.dtype.kind not in "iu":
        return None
    return int(array.elements.reshape(-1)[0])


def _few_turns(function: Function, operation: Operation, operands: list[Array]) -> int | None:
    """Counts the turns of a loop that counts from a known number to a known one, and is short enough to be written out.

    Then indices are known, and what the loop fills need not be in memory.
    """
    numbers, counters = [_read_integer(array) for array in operands], find_counters(operation)
    ends = [
        -(-(limit - number) // step)
        for position, (step, limit, _) in counters.items()
        if limit is not None and (number := numbers[position]) is not None
    ]
    condition, body = operation.regions
    # As many comparisons as counters with known ends means that nothing else ends the loop.
    facts = sum(
        inner.name == "stablehlo.compare" and inner.operands[0].dtype.kind != "b" for inner in condition.operations
    )
    if not ends or len(ends) != facts or any(inner.name not in _OF_CONDITIONS for inner in condition.operations):
        return None
    operations = list(_operations_within(function, body))
    if any(inner.name == "stablehlo.gather" for inner in operations):
        return None  # by indices that operations compute, as the rows of pivots, which stay in memory
    size = sum(result.size for inner in operations for result in inner.results)
    # The first counter at its end ends the loop.
    turns = max(min(ends), 0)
    return turns if 0 < turns <= MOST_TURNS and turns * size <= MOST_NUMBERS else None


def _operations_within(function: Function, block: Block) -> Iterator[Operation]:
    """Yields the operations of a block, with those of the functions that are written where it calls them."""
    for operation in block.every_operation():
        yield operation
        if operation.name == "func.call" and not function.compiler.stays_function(operation.attribute("callee")):
            yield from _operations_within(function, function.compiler.functions[operation.attribute("callee")])


def _write_turns(function: Function, operation: Operation, operands: list[Array], turns: int) -> list[Array]:
    """Writes one turn after another."""
    storage, arrays = function.storage, [function.storage.evaluate(array) for array in operands]
    for array in arrays:
        storage.pin(array)
    for _ in range(turns):
        with function.write_block(operation.regions[1], arrays) as results:
            results = [storage.evaluate(array) for array in results]
            for array in results:  # theirs until they are the next turn's
                storage.pin(array)
        for array in arrays:
            storage.unpin(array)
        arrays = results
    for array in arrays:
        storage.unpin(array)
    return [*arrays]


def _in_lanes(function: Function, operation: Operation, operands: list[Array], loop: Independent) -> list[Array]:
    """Writes as many turns at a time as a vector has lanes; in the last ones some are computed again."""
    b, storage = function.builder, function.storage
    _, body = operation.regions
    arrays: list[Array] = []
    for position, array in enumerate(operands):
        if position in loop.written:
            array = function.overwritable(operation, position, array)
            # In lanes an array would be one of each lane, but here each lane writes an element of the same.
            array.buffer.shared = True
        elif position != loop.counter:
            # A formula would be computed again in every turn.
            array = storage.evaluate(array)
        storage.pin(array)
        arrays.append(array)
    cost = b.cost
    with b.loop(0, -(-loop.turns // LANES)) as turn:
        dtype = operands[loop.counter].dtype
        numbers = ", ".join(f"i64 {lane}" for lane in range(LANES))
        first = b.spread(INDEX, b.times(turn.index, LANES))
        # The last vector computes the last turn in the lanes that would be beyond it, and writes the same once more.
        index = b.clamp(Vector(b.pure(f"add nuw nsw {vector_type(INDEX)} {first}, <{numbers}>", True)), loop.turns - 1)
        # The body compares its counter with constants of its own type.
        if dtype.itemsize < INDEX.itemsize:
            index = Vector(b.convert("trunc", INDEX, dtype, index))
        body_arguments = [*arrays]
        body_arguments[loop.counter] = registers(dtype, [index], ())
        function.in_lanes = True
        with function.write_block(body, body_arguments):
            pass
        function.in_lanes = False
        function.looks_for_signals(b.cost - cost)
    for position, array in enumerate(arrays):
        storage.unpin(array)
        if position in loop.written:
            array.buffers[0].shared = False
    arrays[loop.counter] = Registers(dtype, np.array(loop.turns, dtype))
    return arrays
