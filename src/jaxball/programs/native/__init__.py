"""A compiler for small programs: from StableHLO, to which JAX lowers functions, to machine code, by LLVM.

XLA is built for large arrays: it takes seconds to compile a program of a few thousand operations on single numbers, and
turns it into many small loops. Here such a program is written as LLVM IR, number by number, in tenths of a second.

``pipeline`` lists the passes. They are in these rooms, from the bottom up:

- ``targets``: processors, LLVM for them, the driver of a GPU.
- ``ir``: StableHLO as data, with the last use of each value; numbers, known and unknown; LLVM IR as text, with constant
  folding, common subexpressions written once, and loop-invariant code moved before loops; which turns of loops are
  independent, and bounds of their counters.
- ``emit``: arrays in registers, in memory, or as formulas of an index, and who owns the memory; what each operation
  computes, one file for each family, in ``operations``; functions, and the main one.
- ``calls``: how Python, XLA, and threads of a CPU or of a GPU call the main function.

Around them are ``arguments``, their types; ``tracing``, functions traced by JAX; ``choice``, of the compiler;
``executable`` and ``gpu``, programs that are called; and ``limits``, all sizes that decide what is written how.

It contains nothing specific to mechanics.
"""

from .arguments import are_numbers, as_keys, implementations, kind, numbers, some_traced, type_of
from .calls.handler import Rows
from .choice import (
    Refusal,
    compiler,
    current_choice,
    explicit_choice,
    identity_on_gpu,
    is_allowed,
    is_allowed_on_gpu,
    is_usable,
    on_one_cpu,
    settings,
    warn_if_chosen_by_name,
)
from .executable import CallbackReachedError, Executable, Form
from .gpu import GridExecutable, GridForm
from .ir.turns import FOR_LANES
from .limits import FEWEST, LANES
from .targets.cuda import CudaError
from .targets.machine import identity
from .tracing import Lowered, is_traced_natively

__all__ = [
    "FEWEST",
    "FOR_LANES",
    "LANES",
    "CallbackReachedError",
    "CudaError",
    "Executable",
    "Form",
    "GridExecutable",
    "GridForm",
    "Lowered",
    "Refusal",
    "Rows",
    "are_numbers",
    "as_keys",
    "compiler",
    "current_choice",
    "explicit_choice",
    "identity",
    "identity_on_gpu",
    "implementations",
    "is_allowed",
    "is_allowed_on_gpu",
    "is_traced_natively",
    "is_usable",
    "kind",
    "numbers",
    "on_one_cpu",
    "settings",
    "some_traced",
    "type_of",
    "warn_if_chosen_by_name",
]
