"""Compiles programs: StableHLO's functions, operation by operation, to functions of LLVM IR.

``operations`` has a rule for each operation, a function that writes its computation, and registers it here.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

import numpy as np

from ..ir.elements import Element, UnsupportedError
from ..ir.module import Module
from ..ir.program import Block, Operation, Value
from ..ir.turns import Varying
from ..limits import MOST_INLINED
from ..targets.machine import HOST, Target
from .buffers import Buffer
from .builder import Builder
from .scalars import ELEMENTWISE, scalar
from .storage import Storage
from .values import Array, Formula, Memory, Registers, is_small

# Of the Function being compiled, an Operation and its operands, to the result or a list of results.
Rule: TypeAlias = "Callable[[Function, Operation, list[Array]], Array | list[Array]]"

RULES: dict[str, Rule] = {}


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Registers a function as the rule of operations with these names."""

    def enter(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, function))
        return function

    return enter


# Why a program stopped before its end: a signal, or because it cannot do what comes next.
INTERRUPTED_CODE, REFUSED = 1, 2


class Compiler:
    """One program, by its functions; the first is ``main``.

    - ``target``: what its processor can do.
    """

    def __init__(self, functions: dict[str, Block], target: Target = HOST):
        self.functions, self.module = functions, Module(target)
        self.compiled: dict[str, int] = {}  # instructions of those that are functions of LLVM's as well, by their names
        self._sizes: dict[str, int] = {}
        self._calls: dict[str, int] = {}
        self.indexed: set[Value] = set()
        self.longest_map = 0  # turns of the longest loop of independent turns that is not in vectors
        self.refuses = False
        self._survey("main")
        # Every run would stop there, and be begun again by XLA. Behind a branch most runs do not.
        if any(map(is_callback, self._always_executed(functions["main"]))):
            raise UnsupportedError("A callback of Python")

    def _always_executed(self, block: Block) -> Iterator[Operation]:
        """Yields the operations of a block that no branch decides about."""
        for operation in block.operations:
            yield operation
            inner = operation.regions if operation.name == "stablehlo.while" else []
            if operation.name == "func.call":
                inner = [self.functions[operation.attribute("callee")]]
            for region in inner:
                yield from self._always_executed(region)

    def _survey(self, name: str) -> int:
        """Counts the operations of a function and its calls, and notes which values are indexed by numbers."""
        if name not in self._sizes:
            block = self.functions[name]
            operations = list(block.every_operation())
            self._sizes[name] = len(operations)
            # Backwards: that a loop or a function indexes its argument is known before the value is that it is given.
            for operation in reversed(operations):
                if operation.name == "func.call":
                    self._sizes[name] += self._survey(operation.attribute("callee"))
                self._note_indexed(operation)
        self._calls[name] = self._calls.get(name, 0) + 1
        return self._sizes[name]

    def _note_indexed(self, operation: Operation) -> None:
        if operation.name in _INDEXING:
            count = max((len(operation.operands) - 1) // 2, 1) if operation.name == "stablehlo.scatter" else 1
            self.indexed.update(operation.operands[:count])
        inner: Sequence[Block] = ()
        if operation.name == "func.call":
            inner = [self.functions[operation.attribute("callee")]]
        elif operation.name == "stablehlo.while":
            inner = operation.regions
        for block in inner:
            for value, argument in zip(operation.operands, block.arguments, strict=True):
                if argument in self.indexed:
                    self.indexed.add(value)

    def stays_function(self, name: str) -> bool:
        """Returns whether a function is not written where it is called."""
        return self._calls[name] > 1 and self._sizes[name] > MOST_INLINED

    def in_registers(self, value: Value, most: int = 0) -> bool:
        """Returns whether a value that is handed on, to a function or to a loop's next turn, is in registers."""
        # A register has no place that a number could index: such an array would be written to memory at each handing
        # on.
        return (is_small(value.shape) or value.size <= most) and value not in self.indexed


_INDEXING = ("stablehlo.dynamic_slice", "stablehlo.dynamic_update_slice", "stablehlo.gather", "stablehlo.scatter")


class Function:
    """The function of LLVM's that is being written, and where the values of its operations are."""

    def __init__(self, compiler: Compiler, abort: str):
        self.compiler, self.module = compiler, compiler.module
        self.builder = Builder(compiler.module)
        self.storage = Storage(self.builder)
        self.abort = abort
        self.values: dict[Value, Array] = {}
        self.in_lanes = False  # whether several turns of a loop are computed side by side

    # Blocks

    @contextlib.contextmanager
    def write_block(self, block: Block, arguments: Sequence[Array]) -> Iterator[list[Array]]:
        """Writes a block's operations; its results, which are the block's until the end of this block of Python."""
        for value, array in zip(block.arguments, arguments, strict=True):
            self.bind(value, array)
        for operation in block.operations:
            self.execute(operation)
        yield [self.values[value] for value in block.results]
        # Each once, in their order: a set would free memory in another order in each process.
        for value in dict.fromkeys(block.results):
            if value.block is block:
                self.unbind(value)

    def execute(self, operation: Operation) -> None:
        """Writes one operation."""
        rule = RULES.get(operation.name)
        if rule is None:
            raise UnsupportedError(operation.name)
        values, mark = self.values, self.storage.mark()
        results = rule(self, operation, [values[value] for value in operation.operands])
        if isinstance(results, list):
            for value, array in zip(operation.results, results, strict=True):
                self.bind(value, array)
        else:
            self.bind(operation.results[0], results)
        # Behind the results, which would otherwise be put into memory from which they are still computed.
        for value in operation.last:
            self.unbind(value)
        self.storage.free_unused(mark)

    def bind(self, value: Value, array: Array) -> None:
        """Says where a value is. A formula stays one where it is used once, or costs nothing."""
        # Nothing would unbind it, and its memory would never be free.
        if not value.reads:
            return
        if isinstance(array, Formula):
            # A region may be executed many times: a formula that is read in one would be computed in each.
            once = value.reads == 1 and not value.captured
            if is_small(array.shape) or array.deep or not (once or array.cheap):
                array = self.storage.evaluate(array)
        if array.buffers:
            self.storage.add_owner(array)
        self.values[value] = array

    def unbind(self, value: Value) -> None:
        """Records that a value is no longer read."""
        array = self.values.pop(value, None)
        if array is not None and array.buffers:
            self.storage.drop_owner(array)

    def varying(self) -> Varying:
        """Records which of the following values differ between lanes."""
        return Varying(self.compiler.functions, lambda value: self.values[value].varying)

    def transfer_owner(self, operation: Operation, value: Value) -> None:
        """Leaves a value that only this operation still reads, once, to the instructions that are written in the
        operation's place.

        Its buffers are not free meanwhile, but have no owner until the argument there is bound, which may then be
        overwritten.
        """
        if value in operation.last and operation.reads[value] == 1:
            for buffer in self.values.pop(value).buffers:
                buffer.owners -= 1

    def overwritable(self, operation: Operation, position: int, array: Array, lanes: bool = False) -> Memory:
        """Returns an operand in memory that the operation may write to: in place where :mod:`buffers` allows it.

        ``lanes``: each lane has an array of its own, unless it is one of which each writes its own part.
        """
        value = operation.operands[position]
        if isinstance(array, Memory) and array.buffer.shared:
            return array
        is_last = value in operation.last and operation.reads[value] == 1
        if is_last and isinstance(array, Memory) and array.buffer.writable and array.varying >= lanes:
            # Formulas that still read the old numbers are computed first, if they are of this block: what is computed
            # in a branch is there in no other, and not behind it.
            if array.buffer.owners > 1 and value.block is operation.results[position].block:
                self._evaluate_readers(value, array.buffer)
            if array.buffer.owners == 1:
                return array
        return self.storage.copy_of(array, lanes)

    def _evaluate_readers(self, value: Value, buffer: Buffer) -> None:
        """Computes the formulas of the same block that read a buffer."""
        for other, array in list(self.values.items()):
            if isinstance(array, Formula) and other.block is value.block and buffer in array.buffers:
                evaluated = self.storage.evaluate(array)
                self.storage.add_owner(evaluated)
                self.storage.drop_owner(array)
                self.values[other] = evaluated

    def combination(self, block: Block) -> Callable[..., Sequence[Element]]:
        """Returns the function that a region computes of single numbers."""
        # Usually a sum or a maximum, of many elements: no array is made around each of them.
        if len(block.operations) == 1:
            (operation,) = block.operations
            plain = operation.short_name in ELEMENTWISE and block.results == operation.results
            if plain and operation.operands == block.arguments:
                compute = scalar(operation)
                return lambda *elements: (compute(self.builder, *elements),)

        def combine(*elements: Element) -> list[Element]:
            arguments: list[Array] = []
            for value, element in zip(block.arguments, elements, strict=True):
                array = np.empty((), object)
                array[()] = element
                arguments.append(Registers(value.dtype, array))
            with self.write_block(block, arguments) as results:
                return [self.storage.to_registers(result).element(self.builder, ()) for result in results]

        return combine

    @property
    def uses_vectors(self) -> bool:
        """Whether short arrays are computed in vectors: not where each lane of vectors has an array of its own."""
        return self.module.target.has_vectors and not self.in_lanes

    def refuse(self) -> None:
        """Ends the program, which must be run by another compiler, from the beginning.

        **Raises:** ``UnsupportedError`` where there is nobody who could run it.
        """
        if not self.module.target.has_signals:
            raise UnsupportedError("A callback of Python")
        b = self.builder
        self.compiler.refuses = True
        b.write(f"store i8 {REFUSED}, ptr {b.address('%control', 8)}")
        b.write("store i64 -1, ptr %control")
        b.write(self.abort)
        # Instructions follow, which belong to some block.
        b.begin(b.new_label("never"))

    def looks_for_signals(self, cost: int) -> None:
        """Ends the function if Python has a signal to handle; checked after a number of instructions."""
        if not self.module.target.has_signals:
            return
        b = self.builder
        left = b.effect(f"sub i64 {b.effect('load i64, ptr %control')}, {max(cost, 1)}")
        b.write(f"store i64 {left}, ptr %control")
        look, stop, go_on = (b.new_label(name) for name in ("look", "stop", "on"))
        b.branch(b.effect(f"icmp slt i64 {left}, 0"), look, go_on)
        b.begin(look)
        b.branch(b.effect("call i1 @looks_for_signals(ptr %control)"), stop, go_on)
        b.begin(stop)
        b.write(self.abort)
        b.begin(go_on)


def is_callback(operation: Operation) -> bool:
    """Returns whether an operation calls a function of Python."""
    return operation.name == "stablehlo.custom_call" and "python" in operation.attribute("call_target_name")
