"""Operations on single numbers as functions of arrays, with and without C's library, in single numbers and in lanes."""

import ctypes

import numpy as np

from jaxball.programs.native.emit.builder import Builder
from jaxball.programs.native.emit.values import load, store
from jaxball.programs.native.ir.elements import part_of
from jaxball.programs.native.ir.module import Module
from jaxball.programs.native.limits import ALIGNMENT, LANES
from jaxball.programs.native.targets.machine import HOST, Code, object_code


def written_program(compute, source, target, operands, has_library=True, in_lanes=False):
    """Writes a program, as LLVM's IR, that applies ``compute(builder, dtype, *elements)`` to the elements of arrays.

    - ``source``, ``target``: the types of the operands and of the result.
    """
    module = Module(HOST._replace(has_library=has_library))
    b = Builder(module)
    inputs = [[f"%x{k}.{part}" for part in range(1 + (source.kind == "c"))] for k in range(operands)]
    outputs = [f"%y{part}" for part in range(1 + (target.kind == "c"))]

    def addresses(arrays, index, dtype):
        return [b.address(array, b.times(index, part_of(dtype).itemsize)) for array in arrays]

    with b.loop(0, "%n") as turn:
        index = b.times(turn.index, LANES) if in_lanes else turn.index
        elements = [load(b, source, addresses(arrays, index, source), in_lanes) for arrays in inputs]
        store(b, target, compute(b, source, *elements), addresses(outputs, index, target), in_lanes)
    b.write("ret void")
    pointers = ", ".join(f"ptr {name}" for name in [part for parts in inputs for part in parts] + outputs)
    module.functions.append(b.function(f"void @run({pointers}, i64 %n)"))
    return module.text()


class Compiled:
    """Such a program, called with arrays of one axis; in lanes, their length is a multiple of those."""

    def __init__(self, compute, source, target, operands, has_library=True, in_lanes=False):
        self.source, self.target, self.in_lanes = np.dtype(source), np.dtype(target), in_lanes
        self.text = written_program(compute, self.source, self.target, operands, has_library, in_lanes)
        self._code = Code(object_code(self.text))
        count = operands * (1 + (self.source.kind == "c")) + 1 + (self.target.kind == "c")
        kind = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * count, ctypes.c_int64)
        self._run = kind(self._code.address("run"))

    def __call__(self, *arrays):
        arrays = [np.asarray(array, self.source) for array in arrays]
        size = arrays[0].size
        parts = [
            part for array in arrays for part in ([array.real, array.imag] if self.source.kind == "c" else [array])
        ]
        copies = []
        for part in parts:
            copies.append(_aligned(size, part.dtype))
            copies[-1][:] = part
        results = [_aligned(size, part_of(self.target)) for _ in range(1 + (self.target.kind == "c"))]
        self._run(*(array.ctypes.data for array in (*copies, *results)), size // LANES if self.in_lanes else size)
        if self.target.kind != "c":
            return results[0]
        result = np.empty(size, self.target)
        result.real, result.imag = results
        return result


def _aligned(size, dtype):
    memory = np.empty(size * dtype.itemsize + ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % ALIGNMENT
    return memory[start : start + size * dtype.itemsize].view(dtype)
