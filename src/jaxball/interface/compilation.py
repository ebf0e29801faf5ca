"""Whether this process is compiling something, which the line of an activity says."""

import contextlib
from collections.abc import Iterator

_compilations: list[None] = []  # one for each thread that compiles


@contextlib.contextmanager
def compiling() -> Iterator[None]:
    """Around what compiles a program; blocks may be within each other, and in several threads."""
    _compilations.append(None)
    try:
        yield
    finally:
        _compilations.pop()


def is_compiling() -> bool:
    """Whether any thread is in such a block."""
    return bool(_compilations)
