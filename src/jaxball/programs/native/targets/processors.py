"""The kinds of processors that programs are written for, this machine and a thread of a GPU, and what each can do."""

from typing import NamedTuple

from ..limits import MOST_ON_STACK, MOST_ON_STACK_OF_GPU


class Target(NamedTuple):
    """What a kind of processor offers to programs.

    - ``has_library``: elementary functions of the C library, where they take less time than this package's own.
    - ``has_routines``: LAPACK and BLAS.
    - ``has_vectors``: vectors of numbers.
    - ``has_signals``: Python, which may have a signal to handle, and another compiler that can take over.
    - ``most_on_stack``: bytes of an array on the stack; larger ones are in the memory to work in.
    """

    has_library: bool
    has_routines: bool
    has_vectors: bool
    has_signals: bool
    most_on_stack: int


HOST = Target(has_library=True, has_routines=True, has_vectors=True, has_signals=True, most_on_stack=MOST_ON_STACK)
# One of a GPU's.
THREAD = Target(
    has_library=False, has_routines=False, has_vectors=False, has_signals=False, most_on_stack=MOST_ON_STACK_OF_GPU
)


def host_for(rows: bool) -> Target:
    """Returns the processor of this machine.

    - ``rows``: for a program that computes rows, which have the bits of a GPU's threads if they are computed in lanes.
      Lanes never call the C library; what all rows share does not, either.
    """
    return HOST._replace(has_library=False) if rows else HOST
