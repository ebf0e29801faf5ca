"""What the processors can do that programs are written for."""

from typing import NamedTuple


class Target(NamedTuple):
    """A kind of processor, by what programs use there.

    - ``has_library``: elementary functions of the C library, where they take less time than this package's own.
    - ``has_routines``: LAPACK and BLAS.
    - ``has_vectors``: vectors of numbers.
    - ``has_signals``: Python, which may have a signal to handle, and another compiler that can take over.
    """

    has_library: bool
    has_routines: bool
    has_vectors: bool
    has_signals: bool


HOST = Target(has_library=True, has_routines=True, has_vectors=True, has_signals=True)
THREAD = Target(has_library=False, has_routines=False, has_vectors=False, has_signals=False)  # one of a GPU's


def host_for(rows: bool) -> Target:
    """The processor of this machine.

    - ``rows``: for a program that computes rows, which have the bits of :func:`thread_for`. Lanes of vectors never call
      the C library; what all rows share does not, either, and neither do rows that are computed one by one.
    """
    return HOST._replace(has_library=False) if rows else HOST


def thread_for(in_lanes: bool) -> Target:
    """A thread of a GPU, for the same programs: it gives the bits that rows have on a CPU.

    Whether a sum takes up a product without rounding it depends on what is in vectors. So what is in vectors on a CPU
    is written so for a GPU, too, where LLVM takes them apart.
    """
    return THREAD._replace(has_vectors=not in_lanes)
