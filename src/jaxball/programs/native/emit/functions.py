"""Functions that are not inlined: written once as functions of LLVM IR, and called."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..ir.elements import Element, Vector, vector_type
from ..ir.program import Block, Value
from ..limits import LANES
from .builder import BOOL, Builder
from .lowering import Function
from .storage import join_parts, parts, parts_of
from .values import Array, Buffer, Memory, Registers, registers
from .vectors import are_handed_on, in_vectors, number_of_vectors, one_by_one


class _Form(NamedTuple):
    """How an argument or a result is handed over.

    - ``small``: in registers, one for each number; else as an address.
    - ``own``: lanes have each their own, and the numbers are vectors.
    - ``stacked``: in registers, in vectors along its first axis.
    """

    small: bool
    own: bool
    stacked: bool

    def kinds(self, value: Value) -> list[tuple[np.dtype, bool]]:
        """The types of the registers, and whether they are vectors."""
        if self.stacked:
            return [(value.dtype, True)] * number_of_vectors(value.shape)
        return [(dtype, self.own) for dtype in parts_of(value.dtype, value.size)] if self.small else []

    def apart(self, builder: Builder, array: Registers) -> list[Element]:
        """The numbers of the registers."""
        flat = list(array.objects().reshape(-1))
        if self.stacked:
            return in_vectors(builder, array.dtype, array.shape, flat)
        return [number for _, number in parts([array.dtype] * len(flat), flat)]

    def together(self, builder: Builder, value: Value, numbers: Sequence[Element]) -> Registers:
        """The array of these numbers."""
        if self.stacked:
            numbers = one_by_one(builder, value.dtype, value.shape, numbers)
        return registers(value.dtype, join_parts([value.dtype] * value.size, numbers), value.shape)


def _with_type(builder: Builder, kind: tuple[np.dtype, bool], number: Element) -> str:
    dtype, wide = kind
    return f"{vector_type(dtype, LANES * wide)} {builder.operand(dtype, number, LANES * wide)}"


class Signature:
    """How a function of LLVM's is called.

    - ``name``: its name, made of the function's and of the properties of its arguments.
    - ``arguments``, ``results``: the form of each.
    - ``mask_writes``: whether it is called in some lanes only, which are then its last argument in a register.
    """

    def __init__(self, function: Function, name: str, block: Block, varying: Sequence[bool]):
        def form(value: Value, own: bool) -> _Form:
            small = function.compiler.in_registers(value)
            return _Form(small, own, small and function.uses_vectors and are_handed_on(value.shape, value.dtype))

        self.mask_writes = function.builder.mask is not None
        results = function.varying().call(name, varying) if function.in_lanes else [False] * len(block.results)
        self.arguments = list(map(form, block.arguments, varying))
        self.results = list(map(form, block.results, results))
        pattern = "".join("v" if own else "s" for own in varying) + ("m" if self.mask_writes else "")
        self.name = f"{name}.{pattern}" if function.in_lanes else name
        kinds = [vector_type(dtype, LANES * wide) for dtype, wide in self.types_of_results(block)]
        self.type = f"{{ {', '.join(kinds)} }}" if kinds else "void"

    def types_of_results(self, block: Block) -> list[tuple[np.dtype, bool]]:
        """The types of the numbers that are returned, and whether they are vectors."""
        return [kind for value, form in zip(block.results, self.results, strict=True) for kind in form.kinds(value)]


def compile_function(caller: Function, name: str, varying: Sequence[bool]) -> Signature:
    """A function of the program as an LLVM function, written when it is first needed."""
    compiler = caller.compiler
    block = compiler.functions[name]
    signature = Signature(caller, name, block, varying)
    if signature.name in compiler.compiled:
        return signature
    function = Function(compiler, "ret void" if signature.type == "void" else f"ret {signature.type} zeroinitializer")
    function.in_lanes = caller.in_lanes
    b, storage = function.builder, function.storage
    given, arguments = ["ptr %control", "ptr %workspace"], []
    for position, (value, form) in enumerate(zip(block.arguments, signature.arguments, strict=True)):
        if not form.small:
            given.append(f"ptr noalias readonly %a{position}")
            buffer = Buffer(f"%a{position}", 0, writable=False, lanes=form.own)
            arguments.append(Memory(value.shape, value.dtype, buffer))
            continue
        numbers: list[Element] = []
        for k, (dtype, wide) in enumerate(form.kinds(value)):
            kind, name = vector_type(dtype, LANES * wide), f"%a{position}.{k}"
            given.append(f"{kind} {name}")
            # Lanes can be taken out of a vector that has a line of its own.
            name = b.effect(f"bitcast {kind} {name} to {kind}", LANES) if form.stacked else name
            numbers.append(Vector(name) if wide else name)
        arguments.append(form.together(b, value, numbers))
    if signature.mask_writes:
        given.append(f"{vector_type(BOOL)} %mask")
        b.mask, b.level = Vector("%mask"), 1
    with function.write_block(block, arguments) as results:
        types_of_results = []
        for position, (array, form) in enumerate(zip(results, signature.results, strict=True)):
            if form.small:
                types_of_results += form.apart(b, storage.to_registers(array))
            else:
                given.append(f"ptr noalias %r{position}")
                target = Buffer(f"%r{position}", 0, lanes=form.own, level=b.level)
                storage.fill(Memory(array.shape, array.dtype, target), array)
    result = "undef"
    for position, (kind, number) in enumerate(zip(signature.types_of_results(block), types_of_results, strict=True)):
        result = b.effect(f"insertvalue {signature.type} {result}, {_with_type(b, kind, number)}, {position}")
    b.write("ret void" if signature.type == "void" else f"ret {signature.type} {result}")
    compiler.module.functions.append(b.function(f"internal {signature.type} @{signature.name}({', '.join(given)})"))
    compiler.compiled[signature.name] = b.cost
    return signature


def call_function(function: Function, name: str, block: Block, operands: Sequence[Array]) -> list[Array]:
    """The results of a call."""
    signature = compile_function(function, name, [array.varying for array in operands])
    b, storage = function.builder, function.storage
    given = ["ptr %control", "ptr %workspace"]
    for value, array, form in zip(block.arguments, operands, signature.arguments, strict=True):
        if form.small:
            numbers = form.apart(b, storage.to_registers(array))
            given += [_with_type(b, kind, number) for kind, number in zip(form.kinds(value), numbers, strict=True)]
        else:
            given.append(f"ptr {storage.to_memory(array).buffer.name}")
    if signature.mask_writes:
        given.append(f"{vector_type(BOOL)} {b.mask}")
    memory: list[Array] = []
    for value, form in zip(block.results, signature.results, strict=True):
        if not form.small:
            target = storage.allocate(value.shape, value.dtype, form.own)
            given.append(f"ptr {target.buffer.name}")
            memory.append(target)
    call = f"call {signature.type} @{signature.name}({', '.join(given)})"
    b.cost += function.compiler.compiled[signature.name]
    if signature.type == "void":
        b.write(call)
        return memory
    returned = b.effect(call)
    numbers = iter(
        [
            b.effect(f"extractvalue {signature.type} {returned}, {k}", LANES * wide)
            for k, (_, wide) in enumerate(signature.types_of_results(block))
        ]
    )
    in_memory, results = iter(memory), []
    for value, form in zip(block.results, signature.results, strict=True):
        own = [next(numbers) for _ in form.kinds(value)]
        results.append(form.together(b, value, own) if form.small else next(in_memory))
    return results
