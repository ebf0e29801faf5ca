"""Functions that stay functions: written once as functions of LLVM's IR, and called."""

from collections.abc import Sequence

import numpy as np

from .elements import llvm_type, written
from .lowering import Compiler, Function
from .program import Block
from .storage import joined, parts, parts_of
from .values import Array, Buffer, Memory, registers


class Signature:
    """How a function of LLVM's is called: which arguments and results are in registers."""

    def __init__(self, compiler: Compiler, block: Block):
        self.arguments = [compiler.in_registers(value) for value in block.arguments]
        self.results = [compiler.in_registers(value) for value in block.results]
        kinds = [llvm_type(dtype) for dtype in self.returned(block)]
        self.type = f"{{ {', '.join(kinds)} }}" if kinds else "void"

    def returned(self, block: Block) -> list[np.dtype]:
        """The types of the numbers that are returned."""
        return [
            dtype
            for value, small in zip(block.results, self.results, strict=True)
            if small
            for dtype in parts_of(value.dtype, value.size)
        ]


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
        dtypes, kinds = [value.dtype] * value.size, parts_of(value.dtype, value.size)
        names = [f"%a{position}.{k}" for k in range(len(kinds))]
        given += [f"{llvm_type(kind)} {name}" for kind, name in zip(kinds, names, strict=True)]
        arguments.append(registers(value.dtype, joined(dtypes, names), value.shape))
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
        own = [next(numbers) for _ in parts_of(value.dtype, value.size)]
        elements = joined([value.dtype] * value.size, own)
        results.append(registers(value.dtype, elements, value.shape))
    return results
