"""Programs compiled: StableHLO's functions, operation by operation, to functions of LLVM's IR."""

import contextlib
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from .builder import Builder, Module
from .elements import Element, UnsupportedError, llvm_type, written
from .program import Block, Operation, Value
from .rules import RULES
from .storage import Storage, joined, parts
from .values import Array, Buffer, Formula, Memory, Registers, is_small, size_of, store

MOST_INLINED = 200  # operations of a function that is called more than once and still written where it is called
ALIGNMENT = 64
# Instructions between two looks at signals: some milliseconds.
PATIENCE = 5_000_000

# What a program looks at in between: the instructions left until it next looks for signals, whether it shall stop, and
# the state of Python's thread, which has given up Python's lock.
SUPPORT = f"""
declare ptr @PyEval_SaveThread()
declare void @PyEval_RestoreThread(ptr)
declare i32 @PyErr_CheckSignals()

define internal i1 @looks_for_signals(ptr %control) noinline cold {{
entry:
  %place = getelementptr i8, ptr %control, i64 8
  %state.place = getelementptr i8, ptr %control, i64 16
  %before = load i8, ptr %place
  %stopped = icmp ne i8 %before, 0
  br i1 %stopped, label %stop, label %look
look:
  store i64 {PATIENCE}, ptr %control
  %state = load ptr, ptr %state.place
  call void @PyEval_RestoreThread(ptr %state)
  %raised = call i32 @PyErr_CheckSignals()
  %new = call ptr @PyEval_SaveThread()
  store ptr %new, ptr %state.place
  %interrupted = icmp ne i32 %raised, 0
  br i1 %interrupted, label %stop, label %continue
stop:
  store i8 1, ptr %place
  store i64 -1, ptr %control
  ret i1 true
continue:
  ret i1 false
}}

define void @run(ptr %inputs, ptr %outputs, ptr %workspace) {{
  %control = alloca [24 x i8], align 8
  %place = getelementptr i8, ptr %control, i64 8
  %state.place = getelementptr i8, ptr %control, i64 16
  %state = call ptr @PyEval_SaveThread()
  store i64 {PATIENCE}, ptr %control
  store i8 0, ptr %place
  store ptr %state, ptr %state.place
  call void @main(ptr %control, ptr %workspace, ptr %inputs, ptr %outputs)
  %last = load ptr, ptr %state.place
  call void @PyEval_RestoreThread(ptr %last)
  ret void
}}
"""


class Compiler:
    """One program. ``compiled`` has the names of its functions that are functions of LLVM's as well."""

    def __init__(self, functions: dict[str, Block]):
        self.functions, self.module = functions, Module()
        self.compiled: dict[str, Signature] = {}
        self.costs: dict[str, int] = {}
        self._sizes: dict[str, int] = {}
        self._calls: dict[str, int] = {}
        self.indexed: set[Value] = set()
        self._survey("main")

    def _survey(self, name: str) -> int:
        """Counts the operations of a function and its calls, and notes which values are indexed by numbers."""
        if name not in self._sizes:
            block = self.functions[name]
            operations = list(block.every_operation())
            self._sizes[name] = len(operations)
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
        """Whether a function is not written where it is called."""
        return self._calls[name] > 1 and self._sizes[name] > MOST_INLINED

    def in_registers(self, value: Value) -> bool:
        """Whether a value that is handed on, to a function or to a loop's next turn, is in registers."""
        return is_small(value.shape) and value not in self.indexed


_INDEXING = ("stablehlo.dynamic_slice", "stablehlo.dynamic_update_slice", "stablehlo.gather", "stablehlo.scatter")


class Signature:
    """How a function of LLVM's is called: which arguments and results are in registers."""

    def __init__(self, compiler: Compiler, block: Block):
        self.arguments = [compiler.in_registers(value) for value in block.arguments]
        self.results = [compiler.in_registers(value) for value in block.results]
        kinds = [llvm_type(dtype) for dtype in self.returned(block)]
        self.type = f"{{ {', '.join(kinds)} }}" if kinds else "void"

    def returned(self, block: Block) -> list[np.dtype]:
        """The types of the numbers that are returned."""
        elements = [
            value.dtype for value, small in zip(block.results, self.results, strict=True) if small
            for _ in range(size_of(value.shape))
        ]  # fmt: skip
        zeros = [_zero(dtype) for dtype in elements]
        return [dtype for dtype, _ in parts(elements, zeros)]


def _zero(dtype: np.dtype) -> Element:
    return Registers(dtype, np.zeros((), dtype)).element(None, ())  # type: ignore[arg-type]


class Function:
    """The function of LLVM's that is being written, and where the values of its operations are."""

    def __init__(self, compiler: Compiler, abort: str):
        self.compiler, self.module = compiler, compiler.module
        self.builder = Builder(compiler.module)
        self.storage = Storage(self.builder)
        self.abort = abort
        self.values: dict[Value, Array] = {}

    # Blocks

    @contextlib.contextmanager
    def executed(self, block: Block, arguments: Sequence[Array]) -> Iterator[list[Array]]:
        """Writes a block's operations; its results, which are the block's until the end of this block of Python."""
        for value, array in zip(block.arguments, arguments, strict=True):
            self.bind(value, array)
        for operation in block.operations:
            self.execute(operation)
        yield [self.values[value] for value in block.results]
        for value in set(block.results):
            if value.block is block:
                self.unbind(value)

    def execute(self, operation: Operation) -> None:
        """Writes one operation."""
        rule = RULES.get(operation.name)
        if rule is None:
            raise UnsupportedError(_name(operation))
        mark = self.storage.mark()
        results = rule(self, operation, [self.values[value] for value in operation.operands])
        results = results if isinstance(results, list) else [results]
        for value, array in zip(operation.results, results, strict=True):
            self.bind(value, array)
        for value in operation.last:
            self.unbind(value)
        self.storage.sweep(mark)

    def bind(self, value: Value, array: Array) -> None:
        """Says where a value is. A formula stays one where it is used once, or costs nothing."""
        if not value.reads:
            return
        once = value.reads == 1 and not value.captured
        if isinstance(array, Formula) and (is_small(array.shape) or array.deep or not (once or array.cheap)):
            array = self.storage.settled(array)
        self.storage.owned(array)
        self.values[value] = array

    def unbind(self, value: Value) -> None:
        """Says that nobody reads a value any more."""
        array = self.values.pop(value, None)
        if array is not None:
            self.storage.disowned(array)

    def hand_on(self, operation: Operation, value: Value) -> None:
        """Gives up a value that only this operation still reads, once, to what the operation consists of."""
        if value in operation.last and operation.reads[value] == 1:
            for buffer in self.values.pop(value).buffers:
                buffer.owners -= 1

    def overwritable(self, operation: Operation, position: int, array: Array) -> Memory:
        """An operand in memory that the operation may write to: in place where nobody else reads it any more."""
        value = operation.operands[position]
        if isinstance(array, Memory) and array.buffer.writable:
            if value in operation.last and operation.reads[value] == 1 and array.buffer.owners > 1:
                self._settle_readers(value, array.buffer)
            if value in operation.last and operation.reads[value] == 1 and array.buffer.owners == 1:
                return array
        return self.storage.copied(array)

    def _settle_readers(self, value: Value, buffer: Buffer) -> None:
        """Computes the formulas of the same block that read a buffer."""
        for other, array in list(self.values.items()):
            if isinstance(array, Formula) and other.block is value.block and buffer in array.buffers:
                settled = self.storage.settled(array)
                self.storage.owned(settled)
                self.storage.disowned(array)
                self.values[other] = settled

    def combination(self, block: Block) -> Callable[..., Sequence[Element]]:
        """What a region computes of single numbers."""
        from .operations.elementwise import ELEMENTWISE, scalar

        if len(block.operations) == 1:
            (operation,) = block.operations
            plain = operation.name.partition(".")[2] in ELEMENTWISE and block.results == operation.results
            if plain and operation.operands == block.arguments:
                compute = scalar(operation)
                return lambda *elements: (compute(self.builder, *elements),)

        def combine(*elements: Element) -> list[Element]:
            arguments: list[Array] = []
            for value, element in zip(block.arguments, elements, strict=True):
                array = np.empty((), object)
                array[()] = element
                arguments.append(Registers(value.dtype, array))
            with self.executed(block, arguments) as results:
                return [self.storage.to_registers(result).element(self.builder, ()) for result in results]

        return combine

    def looks_for_signals(self, cost: int) -> None:
        """Ends the function if Python has a signal to handle; looked at after so many instructions."""
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


def _name(operation: Operation) -> str:
    if operation.name == "stablehlo.custom_call":
        return f"{operation.name} of {operation.attribute('call_target_name')}"
    return operation.name


class Entry:
    """The text of a compiled program, and how it is called.

    - ``text``: LLVM's IR of a function ``run(inputs, outputs, workspace)``: the addresses of the arguments, one array
      in which all results lie, and memory to work in.
    - ``results``: offset in bytes, shape and type of each result.
    - ``size``: bytes of all results; ``workspace``: those to work in.
    """

    def __init__(self, compiler: Compiler):
        block = compiler.functions["main"]
        function = Function(compiler, "ret void")
        arguments = [_argument(function, compiler, value, position) for position, value in enumerate(block.arguments)]
        self.results: list[tuple[int, tuple[int, ...], np.dtype]] = []
        self.size = 0
        with function.executed(block, arguments) as results:
            for array in results:
                self.results.append((self.size, array.shape, array.dtype))
                address = function.builder.address("%outputs", self.size)
                function.storage.fill(Memory(array.shape, array.dtype, Buffer(address, 0)), array)
                self.size += -(-max(size_of(array.shape) * array.dtype.itemsize, 1) // ALIGNMENT) * ALIGNMENT
        function.builder.write("ret void")
        head = "internal void @main(ptr %control, ptr %workspace, ptr %inputs, ptr %outputs)"
        compiler.module.functions.append(function.builder.function(head))
        self.workspace = compiler.module.workspace
        self.text = SUPPORT + compiler.module.text()


def _argument(function: Function, compiler: Compiler, value: Value, position: int) -> Array:
    b = function.builder
    address = b.effect(f"load ptr, ptr {b.address('%inputs', 8 * position)}")
    memory = Memory(value.shape, value.dtype, Buffer(address, 0, writable=False))
    return function.storage.to_registers(memory) if compiler.in_registers(value) else memory


def compile_function(compiler: Compiler, name: str) -> Signature:
    """A function of the program as a function of LLVM's, written when it is first asked for."""
    if name in compiler.compiled:
        return compiler.compiled[name]
    block = compiler.functions[name]
    signature = Signature(compiler, block)
    function = Function(compiler, "ret void" if signature.type == "void" else f"ret {signature.type} zeroinitializer")
    given, arguments = ["ptr %control", "ptr %workspace"], []
    for position, (value, small) in enumerate(zip(block.arguments, signature.arguments, strict=True)):
        if not small:
            given.append(f"ptr noalias readonly %a{position}")
            arguments.append(Memory(value.shape, value.dtype, Buffer(f"%a{position}", 0, writable=False)))
            continue
        dtypes = [value.dtype] * size_of(value.shape)
        kinds = [dtype for dtype, _ in parts(dtypes, [_zero(value.dtype)] * len(dtypes))]
        names = [f"%a{position}.{k}" for k in range(len(kinds))]
        given += [f"{llvm_type(kind)} {name}" for kind, name in zip(kinds, names, strict=True)]
        arguments.append(Registers(value.dtype, _shaped(joined(dtypes, names), value.shape)))
    b, storage = function.builder, function.storage
    with function.executed(block, arguments) as results:
        returned = []
        for position, (array, small) in enumerate(zip(results, signature.results, strict=True)):
            if small:
                flat = list(storage.to_registers(array).objects().reshape(-1))
                returned += [number for _, number in parts([array.dtype] * len(flat), flat)]
            else:
                given.append(f"ptr noalias %r{position}")
                storage.fill(Memory(array.shape, array.dtype, Buffer(f"%r{position}", 0)), array)
    result = "undef"
    for position, (dtype, number) in enumerate(zip(signature.returned(block), returned, strict=True)):
        item = f"{llvm_type(dtype)} {written(number)}"
        result = b.effect(f"insertvalue {signature.type} {result}, {item}, {position}")
    b.write("ret void" if signature.type == "void" else f"ret {signature.type} {result}")
    compiler.module.functions.append(b.function(f"internal {signature.type} @{name}({', '.join(given)})"))
    compiler.costs[name] = b.cost
    compiler.compiled[name] = signature
    return signature


def _shaped(elements: Sequence[Element], shape: tuple[int, ...]) -> np.ndarray:
    array = np.empty(len(elements), object)
    for position, element in enumerate(elements):
        array[position] = element
    return array.reshape(shape)


def call_function(function: Function, name: str, block: Block, operands: Sequence[Array]) -> list[Array]:
    """The results of a call."""
    signature = compile_function(function.compiler, name)
    b, storage = function.builder, function.storage
    given = ["ptr %control", "ptr %workspace"]
    for array, small in zip(operands, signature.arguments, strict=True):
        if small:
            flat = list(storage.to_registers(array).objects().reshape(-1))
            numbers = parts([array.dtype] * len(flat), flat)
            given += [f"{llvm_type(dtype)} {written(number)}" for dtype, number in numbers]
        else:
            given.append(f"ptr {storage.to_memory(array).buffer.name}")
    results: list[Array] = []
    for value, small in zip(block.results, signature.results, strict=True):
        if not small:
            target = storage.allocate(value.shape, value.dtype)
            given.append(f"ptr {target.buffer.name}")
            results.append(target)
    call = f"call {signature.type} @{name}({', '.join(given)})"
    b.cost += function.compiler.costs[name]
    if signature.type == "void":
        b.write(call)
        return results
    returned = b.effect(call)
    kinds = signature.returned(block)
    numbers = iter([b.effect(f"extractvalue {signature.type} {returned}, {k}") for k in range(len(kinds))])
    memory = iter(results)
    results = []
    for value, small in zip(block.results, signature.results, strict=True):
        if not small:
            results.append(next(memory))
            continue
        dtypes = [value.dtype] * size_of(value.shape)
        count = len(dtypes) * (2 if value.dtype.kind == "c" else 1)
        elements = joined(dtypes, [next(numbers) for _ in range(count)])
        results.append(Registers(value.dtype, _shaped(elements, value.shape)))
    return results


__all__ = ["Compiler", "Entry", "Function", "call_function", "store"]
