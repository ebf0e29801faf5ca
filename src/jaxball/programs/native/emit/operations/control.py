"""Calls of functions, and branches."""

from collections.abc import Iterator, Sequence

import numpy as np

from ...ir.elements import Element, Vector
from ...ir.program import Block, Operation
from .. import uninitialised
from ..buffers import OwnersBefore
from ..functions import Passing, call_function
from ..instructions import BOOL
from ..lowering import Function, rule
from ..values import Array, Memory, is_small


@rule("func.call")
def call(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """Writes a function's operations in the place of the call, or a call, where they are many and called again."""
    name = operation.attribute("callee")
    block = function.compiler.functions[name]
    if name.startswith(uninitialised.NAME):
        return [function.storage.allocate(value.shape, value.dtype) for value in operation.results]
    if function.compiler.stays_function(name):
        return call_function(function, name, block, operands)
    # So that the function, in the place of its call, can overwrite its argument.
    for value in dict.fromkeys(operation.operands):
        function.transfer_owner(operation, value)
    with function.write_block(block, operands) as results:
        for array in results:  # pinned between the end of the block and what is bound to the call's results
            function.storage.pin(array)
    for array in results:
        function.storage.unpin(array)
    return results


@rule("stablehlo.case", "stablehlo.if")
def case(function: Function, operation: Operation, operands: list[Array]) -> list[Array]:
    """Writes one of several regions: by number, where numbers out of range mean the last; or by a condition."""
    b, storage = function.builder, function.storage
    chosen = storage.to_registers(operands[0]).element(b, ())
    regions, after = operation.regions, b.new_label("after")
    # Lanes that go different ways cannot jump: each way is computed where any lane goes it.
    if isinstance(chosen, Vector):
        return _each_way(function, operation, chosen)
    labels = [b.new_label("case") for _ in regions]
    if operation.name == "stablehlo.if":
        b.branch(chosen, *labels)
    else:
        kind = operands[0].dtype
        ways = " ".join(f"i32 {k}, label %{label}" for k, label in enumerate(labels[:-1]))
        number = b.as_index(chosen, kind)
        # An index would be of 64 bits, and the switch is of 32.
        number = number if isinstance(number, int) else chosen
        b.write(f"switch i32 {b.operand(kind, number)}, label %{labels[-1]} [ {ways} ]")
    branches = _OneWay(function, operation)
    for label, region in zip(labels, regions, strict=True):
        b.begin(label)
        with b.scope():
            branches.write(region)
            b.jump(after)
    b.begin(after)
    return branches.results()


class _Branches:
    """The results of branches: in memory that each branch fills, and in registers.

    - ``passing``: how each result is passed on in registers; None where it is in memory.
    - ``targets``: the memory of each result that is in memory, once it is chosen.
    """

    def __init__(self, function: Function, operation: Operation, varying: Sequence[bool]):
        self.function, self.varying = function, varying
        self.passing = [
            Passing(function, value.shape, value.dtype, varies) if is_small(value.shape) else None
            for value, varies in zip(operation.results, varying, strict=True)
        ]
        self.targets: list[Memory | None] = [None] * len(self.passing)
        # Each branch may overwrite what nothing reads behind them, each time as if it were the only one.
        self.last = {value: function.values[value] for value in operation.last if value in function.values}
        self.owners = OwnersBefore(self.last.values())
        for array in self.last.values():
            function.storage.pin(array)

    def move(self, results: Sequence[Array]) -> None:
        """Writes what is in memory to its target, at the end of a branch."""
        rows = zip(self.targets, results, strict=True)
        self.function.storage.move([(target, array) for target, array in rows if target is not None])

    def set_target(self, position: int, target: Memory) -> None:
        """Chooses the memory of a result, for all branches."""
        # It has no owner until all branches are written: a value of a later branch would be put there.
        self.function.storage.pin(target)
        self.targets[position] = target

    def end_branch(self, mark: int) -> None:
        """Makes values and owners again what they were before the branch, and frees what it worked in."""
        # This branch may have been the last to read some of them, and the next one reads them again.
        self.function.values.update(self.last)
        self.owners.restore()
        self.function.storage.free_unused(mark)

    def end(self, numbers: Iterator[Element]) -> list[Array]:
        """Leaves all memory to the values that own it behind the branches.

        - ``numbers``: those of all results in registers, one result after another.

        Returns the results.
        """
        for array in (*self.last.values(), *self.targets):
            if array is not None:
                self.function.storage.unpin(array)
        results: list[Array] = []
        for passing, target in zip(self.passing, self.targets, strict=True):
            if target is not None:
                results.append(target)
            elif passing is not None:
                results.append(passing.join([next(numbers) for _ in passing.kinds]))
        return results


class _OneWay(_Branches):
    """Branches of which one is taken: its results in registers are phis."""

    def __init__(self, function: Function, operation: Operation):
        varying = [False] * len(operation.results)
        if function.in_lanes:
            varying = function.varying().branches(operation, False)
        super().__init__(function, operation, varying)
        self.cases: list[list[tuple[list[Element], str]]] = [[] for _ in self.passing]

    def write(self, region: Block) -> None:
        """Writes one branch."""
        storage = self.function.storage
        mark = storage.mark()
        with self.function.write_block(region, []) as results:
            numbers = []
            # Before arrays move, which may overwrite what these numbers are read from.
            for position, (passing, array) in enumerate(zip(self.passing, results, strict=True)):
                if passing is None and self.targets[position] is None:
                    self._choose_target(position, region, array)
                numbers.append(passing.spread(array) if passing else [])
            self.move(results)
            label = self.function.builder.label  # of the block in which the branch ends, perhaps behind a loop
            for cases, row in zip(self.cases, numbers, strict=True):
                cases.append((row, label))
        self.end_branch(mark)

    def _choose_target(self, position: int, region: Block, array: Array) -> None:
        """Chooses the memory of a result: where the first branch has it already, if nothing else reads it there.

        That may be an array from before the branches, which the branch returns as it is, if nothing reads it behind
        them. Two results need two memories.
        """
        value, target_names = (
            region.results[position],
            {target.buffer.name for target in self.targets if target is not None},
        )
        stays = isinstance(array, Memory) and array.buffer.writable and array.buffer.owners == 1
        stays &= value.block is region or value in self.last
        # Another branch may give each lane an array of its own, for which one of all lanes has no room.
        stays &= array.varying == self.varying[position]
        if not isinstance(array, Memory) or not stays or array.buffer.name in target_names:
            array = self.function.storage.allocate(array.shape, array.dtype, self.varying[position])
        self.set_target(position, array)

    def results(self) -> list[Array]:
        """Returns the results, behind all branches."""
        return self.end(self._phis())

    def _phis(self) -> Iterator[Element]:
        """Yields the numbers of the results in registers, each from the branch that was taken."""
        for passing, cases in zip(self.passing, self.cases, strict=True):
            labels = [label for _, label in cases]
            columns = zip(*(numbers for numbers, _ in cases), strict=True)
            for (kind, _), ways in zip(passing.kinds if passing else [], columns, strict=True):
                yield self.function.builder.phi(kind, list(zip(ways, labels, strict=True)))


def _each_way(function: Function, operation: Operation, chosen: Vector) -> list[Array]:
    """Writes each region in the lanes that go its way, if there are any."""
    b, storage = function.builder, function.storage
    branches = _Branches(function, operation, [True] * len(operation.results))
    for position, value in enumerate(operation.results):
        if branches.passing[position] is None:  # each region fills its lanes of it
            branches.set_target(position, storage.allocate(value.shape, value.dtype, True))
    kinds = [kind for passing in branches.passing if passing for kind, _ in passing.kinds]
    # Each lane goes some way, so that none of these zeros remains.
    numbers: list[Element] = [b.spread(kind, kind.type(0)) for kind in kinds]
    for condition, region in zip(_ways(function, operation, chosen), operation.regions, strict=True):
        with b.mask_writes(condition) as going:
            before, inside, after = b.label, b.new_label("some"), b.new_label("after")
            b.branch(b.any_lane(going), inside, after)
            b.begin(inside)
            mark = storage.mark()
            with b.scope():
                with function.write_block(region, []) as results:
                    rows = zip(branches.passing, results, strict=True)
                    new = [number for passing, array in rows if passing for number in passing.spread(array)]
                    new = [b.select(kind, going, x, y) for kind, x, y in zip(kinds, new, numbers, strict=True)]
                    branches.move(results)
                branches.end_branch(mark)
                last = b.label
                b.jump(after)
            # If no lane goes this way, its block is jumped over, and the numbers are those of the ways before.
            b.begin(after)
            numbers = [b.phi(kind, [(y, before), (x, last)]) for kind, x, y in zip(kinds, new, numbers, strict=True)]
    return branches.end(iter(numbers))


def _ways(function: Function, operation: Operation, chosen: Vector) -> list[Vector]:
    """Returns in which lanes each region is executed."""
    b, dtype = function.builder, operation.operands[0].dtype
    if operation.name == "stablehlo.if":
        return [chosen, Vector(b.binary("xor", BOOL, chosen, np.bool_(True)))]
    ways = [Vector(b.compare("eq", dtype, chosen, dtype.type(k))) for k in range(len(operation.regions) - 1)]
    # Numbers out of range mean the last region, so it is that of the lanes that no other one takes.
    none: Element = b.spread(BOOL, np.bool_(True))
    for way in ways:
        none = b.binary("and", BOOL, none, b.binary("xor", BOOL, way, np.bool_(True)))
    return [*ways, Vector(none)]
