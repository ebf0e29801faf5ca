"""Operations that contain programs: loops, branches, and calls of functions."""

from collections.abc import Sequence

import numpy as np

from ..elements import Element
from ..functions import call_function
from ..lowering import Function
from ..program import Block, Operation
from ..rules import rule
from ..storage import joined, parts, parts_of
from ..values import MOST_REGISTERS, Array, Memory, Registers, is_small, registers, size_of

MOST_UNCHANGED = 256  # numbers of an array that a loop reads and does not change, and that are read once before it


@rule("func.call")
def call(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """A function's operations in the place of the call, or a call, where they are many and called again."""
    name = operation.attribute("callee")
    block = function.compiler.functions[name]
    if function.compiler.stays_function(name):
        return call_function(function, name, block, operands)
    for value in set(operation.operands):
        function.hand_on(operation, value)
    with function.executed(block, operands) as results:
        for array in results:  # theirs until they are the call's
            function.storage.pinned(array, 1)
    for array in results:
        function.storage.pinned(array, -1)
    return results


@rule("stablehlo.while")
def while_(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """The body's results are the next turn's arguments, for as long as the condition holds."""
    b, storage = function.builder, function.storage
    condition, body = operation.regions
    carries = [_Carry(function, operation, position, array) for position, array in enumerate(operands)]
    before, header, inside, after = (b.label, *(b.new_label(name) for name in ("while", "body", "done")))
    with b.looped(), b.scope():
        b.jump(header)
        b.begin(header)
        cost = b.cost
        for carry in carries:
            carry.begin()
        for carry in carries:
            carry.lend(1)  # the condition overwrites nothing
        with function.executed(condition, [carry.array for carry in carries]) as (holds,):
            b.branch(storage.to_registers(holds).element(b, ()), inside, after)
        for carry in carries:
            carry.lend(-1)
        with b.scope():
            b.begin(inside)
            with function.executed(body, [carry.array for carry in carries]) as results:
                in_memory = [
                    (carry.array, result)
                    for carry, result in zip(carries, results, strict=True)
                    if carry.in_memory and isinstance(carry.array, Memory)
                ]
                following = [
                    carry.numbers(result) if carry.phis else [] for carry, result in zip(carries, results, strict=True)
                ]
                storage.move([target for target, _ in in_memory], [source for _, source in in_memory])
            function.looks_for_signals(b.cost - cost)
            for carry, numbers in zip(carries, following, strict=True):
                carry.end(before, numbers)
            b.jump(header)
    b.begin(after)
    for carry in carries:
        carry.release()
    return [carry.array for carry in carries]


class _Carry:
    """One array that a loop carries from turn to turn: unchanged, in memory, or in registers."""

    def __init__(self, function: Function, operation: Operation, position: int, array: Array):
        self.function = function
        condition, body = operation.regions
        arguments = condition.arguments[position], body.arguments[position]
        self.unchanged = body.results[position] is body.arguments[position]
        most = MOST_UNCHANGED if self.unchanged else MOST_REGISTERS
        small = all(function.compiler.in_registers(value, most) for value in arguments) or not arguments[0].size
        self.in_memory = not self.unchanged and not small
        self.phis: list[tuple[int, np.dtype, str]] = []
        self.owners = 0
        storage = function.storage
        if self.unchanged:
            self.array = storage.to_registers(array) if small else storage.anywhere(storage.settled(array))
        elif small:
            self.array = storage.to_registers(array)
        else:
            self.array = function.overwritable(operation, position, array)
        if self.in_memory:
            buffer = self.array.buffers[0]
            self.owners, buffer.owners = buffer.owners, 0
        storage.pinned(self.array, 1)

    def begin(self) -> None:
        """Writes what begins a turn."""
        if self.unchanged or self.in_memory or not isinstance(self.array, Registers):
            return
        b, dtype = self.function.builder, self.array.dtype
        self.first = self.numbers(self.array)
        names = []
        dtypes = [dtype] * size_of(self.array.shape)
        for kind in parts_of(dtype, len(dtypes)):
            names.append(b.fresh())
            self.phis.append((b.reserve(), kind, names[-1]))
        self.array = registers(dtype, joined(dtypes, names), self.array.shape)

    def numbers(self, array: Array) -> list[Element]:
        """The numbers of an array one by one."""
        flat = list(self.function.storage.to_registers(array).objects().reshape(-1))
        return [number for _, number in parts([array.dtype] * len(flat), flat)]

    def end(self, before: str, following: Sequence[Element]) -> None:
        """Writes, at the beginning of a turn, what the last one gave."""
        b = self.function.builder
        for (place, dtype, name), first, new in zip(self.phis, self.first if self.phis else [], following, strict=True):
            b.fill_phi(place, name, dtype, [(first, before), (new, b.label)])

    def lend(self, count: int) -> None:
        if self.in_memory:
            self.array.buffers[0].owners += count

    def release(self) -> None:
        self.function.storage.pinned(self.array, -1)
        if self.in_memory:
            self.array.buffers[0].owners = self.owners


@rule("stablehlo.case", "stablehlo.if")
def case(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """One of several regions: by number, of which those out of range mean the last; or by a condition."""
    b, storage = function.builder, function.storage
    chosen = storage.to_registers(operands[0]).element(b, ())
    regions, after = operation.regions, b.new_label("after")
    labels = [b.new_label("case") for _ in regions]
    if operation.name == "stablehlo.if":
        b.branch(chosen, *labels)
    else:
        kind = operands[0].dtype
        ways = " ".join(f"i32 {k}, label %{label}" for k, label in enumerate(labels[:-1]))
        number = b.as_index(chosen, kind)
        number = number if isinstance(number, int) else chosen
        b.write(f"switch i32 {number}, label %{labels[-1]} [ {ways} ]")
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
        self.targets: list[Memory | None] = [None] * len(self.small)
        self.cases: list[list[tuple[list[Element], str]]] = [[] for _ in self.small]
        # What no one reads after this may be overwritten in each of the branches, each time as if it were the only one.
        self.given = {value: function.values[value] for value in operation.last if value in function.values}
        self.owners = [(buffer, buffer.owners) for array in self.given.values() for buffer in array.buffers]
        for array in self.given.values():
            function.storage.pinned(array, 1)

    def write(self, region: Block) -> None:
        """Writes one branch."""
        function, storage = self.function, self.function.storage
        mark = storage.mark()
        with function.executed(region, []) as results:
            for position, array in enumerate(results):
                if self.small[position]:
                    flat = list(storage.to_registers(array).objects().reshape(-1))
                    numbers = [number for _, number in parts([array.dtype] * len(flat), flat)]
                    self.cases[position].append((numbers, ""))
                elif self.targets[position] is None:
                    self._choose_target(position, array)
            moves = [(target, array) for target, array in zip(self.targets, results, strict=True) if target is not None]
            storage.move([target for target, _ in moves], [array for _, array in moves])
            for position, small in enumerate(self.small):
                if small:
                    numbers, _ = self.cases[position][-1]
                    self.cases[position][-1] = numbers, function.builder.label
        function.values.update(self.given)
        for buffer, owners in self.owners:
            buffer.owners = owners
        storage.sweep(mark)

    def _choose_target(self, position: int, array: Array) -> None:
        """The memory of a result: where the first branch has it already, if that is only its own."""
        taken = {target.buffer.name for target in self.targets if target is not None}
        own = isinstance(array, Memory) and array.buffer.writable and array.buffer.owners == 1
        if not isinstance(array, Memory) or not own or array.buffer.name in taken:
            array = self.function.storage.allocate(array.shape, array.dtype)
        self.function.storage.pinned(array, 1)
        self.targets[position] = array

    def results(self) -> list[Array]:
        """The results, after all branches."""
        storage, b = self.function.storage, self.function.builder
        for array in self.given.values():
            storage.pinned(array, -1)
        results: list[Array] = []
        for value, target, cases in zip(self.operation.results, self.targets, self.cases, strict=True):
            if target is not None:
                storage.pinned(target, -1)
                results.append(target)
                continue
            dtypes = [value.dtype] * value.size
            kinds = parts_of(value.dtype, value.size)
            labels = [label for _, label in cases]
            numbers = [
                b.phi(kind, list(zip(ways, labels, strict=True)))
                for kind, *ways in zip(kinds, *(numbers for numbers, _ in cases), strict=True)
            ]
            results.append(registers(value.dtype, joined(dtypes, numbers), value.shape))
        return results
