"""Makes Python's garbage collector run less often while functions are traced and compiled."""

import contextlib
import gc
import threading
from collections.abc import Iterator

SELDOM = (50_000, 50, 50)  # objects between two searches, and searches between two that look further back

_lock = threading.Lock()
_running, _usual = 0, SELDOM


@contextlib.contextmanager
def seldom_collected() -> Iterator[None]:
    """Makes Python search for garbage less often within this block. Used around functions that trace or compile, also
    as a decorator.

    They make hundreds of thousands of objects, most of which live on. By Python's own thresholds these are looked
    through again and again, which takes an eighth to a fifth of the time. The thresholds are those of the process:
    threads share the block, which ends with the last of them. A search that the user has switched off, or made more
    seldom, stays so.
    """
    global _running, _usual
    with _lock:
        _running += 1
        if _running == 1:
            _usual = gc.get_threshold()
            gc.set_threshold(*_at_least(_usual))
    try:
        yield
    finally:
        with _lock:
            _running -= 1
            if _running == 0 and gc.get_threshold() == _at_least(_usual):  # the user may have changed them meanwhile
                gc.set_threshold(*_usual)


def _at_least(thresholds: tuple[int, int, int]) -> tuple[int, int, int]:
    young, middle, old = map(max, thresholds, SELDOM)
    return (young, middle, old) if thresholds[0] else thresholds
