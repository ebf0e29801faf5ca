"""From StableHLO to machine code: the passes of the compiler, in their order."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .calls.grid import kernel, launcher
from .calls.handler import Part, Rows, bytes_of_table, handler, part_of
from .calls.python import python_call
from .calls.row_threads import rows_in_threads
from .emit import operations  # noqa: F401 (whose rules are entered)
from .emit.functions import Main, emit_main
from .emit.lowering import RULES, Compiler
from .executable import Form, Given
from .gpu import GridForm, compile_for_gpus
from .ir.elements import UnsupportedError
from .ir.program import Block, functions_of
from .limits import LONG_AXIS, MOST_BYTES_OF_TABLE
from .targets.machine import HOST, THREAD, Target, object_code, ptx, routines_in, triple


class Emitted(NamedTuple):
    """A program as LLVM IR, with its arguments and results as they are in one row.

    - ``block``: how many rows it computes at once.
    """

    main: Main
    takes: list[Part]
    gives: list[Part]
    block: int


def compile_for_cpu(
    module: Any,
    takes: Sequence[np.dtype],
    gives: Sequence[Given],
    *,
    large: bool = True,
    quickly: bool = False,
    rows: Rows | None = None,
) -> Form:
    """Compiles a StableHLO module for this processor.

    - ``takes``, ``gives``: the types of its arguments, and shapes and types of its results.
    - ``large``: even if its loops are over large arrays; ``quickly``: as for :func:`~.machine.object_code`.
    - ``rows``: the rows that it computes at once, if it does.

    **Raises:** :class:`UnsupportedError`.
    """
    functions = read_functions(module, len(takes), large)  # StableHLO as data: uses, last uses, nothing unread
    # Rows have the bits of a GPU's threads if they are computed in lanes. Lanes never call the C library; what all rows
    # share does not, either.
    target = HOST if rows is None else HOST._replace(has_library=False)
    emitted = emit(functions, target, rows)  # LLVM IR, operation by operation
    text = cpu_text(emitted)  # with the functions by which it is called
    code = object_code(text, quickly)  # LLVM's passes, and machine code
    main = emitted.main
    offsets = tuple(result.offset for result in main.results)
    return Form(
        code,
        routines_in(text),
        tuple(takes),
        tuple(gives),
        offsets,
        main.size,
        main.workspace,
        main.refuses,
        rows.block if rows else 0,
    )


def compile_for_gpu(module: Any, takes: int, gives: Sequence[Given], large: bool) -> GridForm:
    """Compiles a StableHLO module for the GPUs of this machine.

    - ``takes``: how many arrays it takes; ``gives``: shapes and types of its results.
    - ``large``: even if its loops are over large arrays.

    **Raises:** :class:`UnsupportedError` for what only a CPU can do, and :class:`~.cuda.CudaError` where the driver
    cannot compile it.
    """
    functions = read_functions(module, takes, large)
    emitted = emit(functions, THREAD)
    code = compile_for_gpus(ptx(kernel_text(emitted)))
    launching = handler(emitted.takes, emitted.gives, 1) + launcher(emitted.main.workspace)
    return GridForm(code, object_code(launching), tuple(gives), emitted.main.longest_map)


def read_functions(module: Any, takes: int, large: bool = True) -> dict[str, Block]:
    """Reads the functions of a StableHLO module that takes this number of arrays.

    **Raises:** :class:`UnsupportedError`, also for loops over large arrays, unless they are allowed by ``large``.
    """
    functions = functions_of(module, RULES)
    if not large and _loops_over_large_arrays(functions):
        raise UnsupportedError("A program of loops over large arrays")
    if len(functions["main"].arguments) != takes:
        raise UnsupportedError("A program with arguments of JAX's own")
    return functions


def _loops_over_large_arrays(functions: Mapping[str, Block]) -> bool:
    """Returns whether half or more of the operations within a program's loops produce arrays with a long axis.

    This is the case when many runs are solved side by side. A program of 64 lanes took as long to compile natively as
    by XLA, 22 s, and ten times as long to run. Outside loops large arrays cost little: observables at 201 times at
    once, two thirds of whose operations gave more than 64 numbers, were compiled in 0.8 s instead of 1.0 and ran in
    0.34 ms instead of 0.22.
    """
    lengths: list[int] = []
    _note_axes(functions, functions["main"], False, {}, lengths)
    return bool(lengths) and 2 * sum(length >= LONG_AXIS for length in lengths) >= len(lengths)


def _note_axes(
    functions: Mapping[str, Block], block: Block, in_loop: bool, within: dict[str, bool], lengths: list[int]
) -> None:
    """Notes the longest axes of results within loops; ``within`` says of functions seen whether it was in a loop."""
    for operation in block.operations:
        in_loops = in_loop or operation.name == "stablehlo.while"
        # A loop's own results are not counted, but what its turns compute, once for each operation.
        if in_loop:
            lengths.extend(max(value.shape, default=1) for value in operation.results)
        for region in operation.regions:
            _note_axes(functions, region, in_loops, within, lengths)
        if operation.name == "func.call":
            name = operation.attribute("callee")
            if not within.get(name, False) and (in_loop or name not in within):
                within[name] = in_loop
                _note_axes(functions, functions[name], in_loop, within, lengths)


def emit(functions: dict[str, Block], target: Target = HOST, rows: Rows | None = None) -> Emitted:
    """Writes functions as LLVM IR for a kind of processor.

    **Raises:** :class:`UnsupportedError`.
    """
    main = emit_main(Compiler(functions, target))
    takes = [part_of(value, rows is not None and rows.taken[k]) for k, value in enumerate(main.block.arguments)]
    gives = [part_of(value, rows is not None) for value in main.block.results]
    return Emitted(main, takes, gives, rows.block if rows else 1)


def cpu_text(emitted: Emitted) -> str:
    """Returns the module for this processor.

    Its functions are ``run(inputs, block, workspace)``, for a call from Python, with one array in which all results
    lie; ``rows(shared)``, for many; and ``call(frame)``, for XLA.
    """
    main, takes, gives, block = emitted
    by_xla = handler(takes, gives, block)
    by_threads = rows_in_threads(takes, gives, block, main.workspace, triple())
    return python_call(main.results) + by_xla + by_threads + main.body


def kernel_text(emitted: Emitted) -> str:
    """Returns the module of the kernel.

    **Raises:** :class:`UnsupportedError` for more arrays than a kernel can take.
    """
    main, takes, gives, _ = emitted
    if bytes_of_table([*takes, *gives]) > MOST_BYTES_OF_TABLE:
        raise UnsupportedError(f"A program of {len(takes) + len(gives)} arrays on a GPU")
    return kernel(takes, gives, main.workspace) + main.body
