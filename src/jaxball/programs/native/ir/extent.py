"""The size of a program's arrays: whether XLA, which uses vectors and threads for them, would run it faster."""

from collections.abc import Mapping

from ..limits import LONG_AXIS
from .program import Block


def loops_over_large_arrays(functions: Mapping[str, Block]) -> bool:
    """Whether half or more of the operations within a program's loops produce arrays with a long axis.

    This is the case when many runs are solved side by side. A program of 64 lanes took as long to compile natively as
    by XLA, 22 s, and ten times as long to run. Outside loops large arrays cost little: observables at 201 times at
    once, two thirds of whose operations gave more than 64 numbers, were compiled in 0.8 s instead of 1.0 and ran in
    0.34 ms instead of 0.22.
    """
    lengths: list[int] = []
    _note(functions, functions["main"], False, {}, lengths)
    return bool(lengths) and 2 * sum(length >= LONG_AXIS for length in lengths) >= len(lengths)


def _note(
    functions: Mapping[str, Block], block: Block, in_loop: bool, within: dict[str, bool], lengths: list[int]
) -> None:
    """Notes the longest axes of results within loops; ``within`` says of functions seen whether it was in a loop."""
    for operation in block.operations:
        in_loops = in_loop or operation.name == "stablehlo.while"
        # A loop's own results are not counted, but what its turns compute, once for each operation.
        if in_loop:
            lengths.extend(max(value.shape, default=1) for value in operation.results)
        for region in operation.regions:
            _note(functions, region, in_loops, within, lengths)
        if operation.name == "func.call":
            name = operation.attribute("callee")
            if not within.get(name, False) and (in_loop or name not in within):
                within[name] = in_loop
                _note(functions, functions[name], in_loop, within, lengths)
