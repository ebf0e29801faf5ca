"""A GPU's grid, emulated on a CPU: the text of a kernel, of which a CPU computes one thread after another."""

import contextlib
import ctypes
import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jaxball.programs import operation
from jaxball.programs.computation import Computation
from jaxball.programs.native.calls import grid
from jaxball.programs.native.calls.handler import NEXT, PARTS, ROWS
from jaxball.programs.native.pipeline import Emitted, emit, read_functions
from jaxball.programs.native.targets.machine import THREAD, Code, Target, object_code


def emit_computation(computation: Computation, target: Target = THREAD) -> Emitted:
    """The program of a computation, written for the threads of a GPU."""
    module = computation.traced.for_cpu().compiler_ir("stablehlo")
    return emit(read_functions(module, len(computation.takes)), target)


class Grid:
    """The program of a computation as a GPU would run it, for rows of its arguments."""

    def __init__(self, computation: Computation, target: Target = THREAD):
        self.emitted = emit_computation(computation, target)
        text = (
            grid.emulation(self.emitted.takes, self.emitted.gives, self.emitted.main.workspace) + self.emitted.main.body
        )
        self._code = Code(object_code(text))
        kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
        self._emulate = kind(self._code.address("emulate"))
        self._types = [np.dtype(one.dtype) for one in computation.takes]

    def __call__(self, arrays: Sequence[Any], in_rows: Sequence[bool], threads: int = 5) -> list[np.ndarray]:
        """The results of all rows, computed by this many threads."""
        arrays = [np.ascontiguousarray(array, dtype) for array, dtype in zip(arrays, self._types, strict=True)]
        rows = next((len(array) for array, many in zip(arrays, in_rows, strict=True) if many), 1)
        results = [np.empty((rows, *shape), dtype) for _, shape, dtype in self.emitted.main.results]
        steps = [array.nbytes // rows if many else 0 for array, many in zip(arrays, in_rows, strict=True)]
        steps += [result.nbytes // rows for result in results]
        addresses = [array.ctypes.data for array in (*arrays, *results)]
        memory = np.empty(threads * self.emitted.main.workspace + 64, np.uint8)
        table = (ctypes.c_int64 * (PARTS // 8 + 2 * len(steps)))()
        table[NEXT // 8], table[ROWS // 8] = 0, rows
        table[grid.MEMORY // 8] = memory.ctypes.data + -memory.ctypes.data % 64
        table[PARTS // 8 :] = list(itertools.chain(*zip(addresses, steps, strict=True)))
        for thread in reversed(range(threads)):
            self._emulate(table, thread, threads)
        return results


@contextlib.contextmanager
def recorded() -> Iterator[list[Any]]:
    """Notes the computations of rows that are run within the block: with arrays, which of them have rows, results."""
    compute, calls = operation._compute, []

    def of_run(*arrays, computation, rows):
        results = compute(*arrays, computation=computation, rows=rows)
        if rows:
            calls.append((computation, arrays, rows, results))
        return results

    def of_tangents(*arrays, computation, which, rows):
        return of_run(*arrays, **operation._as_run(computation, which, rows))

    primitives = {operation.run: of_run, operation.tangents_of_run: of_tangents}
    before = {primitive: primitive.impl for primitive in primitives}
    for primitive, recording in primitives.items():
        primitive.def_impl(recording)
    try:
        yield calls
    finally:
        for primitive, implementation in before.items():
            primitive.def_impl(implementation)


def differences(results: Sequence[Any], others: Sequence[Any]) -> int:
    """How many numbers of two lists of arrays are not the same to the last bit; all NaN are the same."""
    count = 0
    for result, other in zip(map(np.asarray, results), map(np.asarray, others), strict=True):
        assert (result.shape, result.dtype) == (other.shape, other.dtype)
        bits = [np.ascontiguousarray(array)[..., None].view(np.uint8) for array in (result, other)]
        same = np.all(bits[0] == bits[1], axis=-1)
        if result.dtype.kind in "fc":
            same |= np.isnan(result) & np.isnan(other)
        count += int(np.sum(~same))
    return count
